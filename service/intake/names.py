"""File names from outside: relative paths inside an upload, and nothing else."""

from __future__ import annotations

import re
import unicodedata

from service.api.problem import Problem

__all__ = ["safe_name"]

MAX_NAME = 1024
MAX_PART = 255
DRIVE = re.compile(r"^[A-Za-z]:")


def safe_name(name: str) -> str:
    """The name as a clean relative path with forward slashes. Raises Problem 422 where it could leave the upload."""
    shown = ascii(name if len(name) <= 120 else name[:117] + "...")
    if not name:
        raise Problem(422, "A file came without a name. Give every file its name, with its folders if it has any.")
    if "\\" in name:
        raise Problem(422, f"The file name {shown} has a backslash. Use forward slashes between folders.")
    if name.startswith("/") or DRIVE.match(name):
        raise Problem(422, f"The file name {shown} is an absolute path. Names are relative to the scene's folder.")
    if any(unicodedata.category(c) in ("Cc", "Cs") for c in name):
        raise Problem(422, f"The file name {shown} has control characters. Rename the file.")
    parts = [part for part in name.split("/") if part not in ("", ".")]
    if ".." in parts:
        raise Problem(422, f"The file name {shown} climbs out of the upload with '..'. Move the file beside the scene.")
    if not parts:
        raise Problem(422, f"The file name {shown} names no file.")
    if len(name.encode()) > MAX_NAME or any(len(part.encode()) > MAX_PART for part in parts):
        raise Problem(422, f"The file name {shown} is too long; {MAX_PART} bytes a part and {MAX_NAME} in all are possible.")
    return "/".join(parts)
