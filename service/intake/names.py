"""Validation of names from users: relative paths of uploaded files, titles and notes."""

from __future__ import annotations

import re

from renderer.printable import one_line
from renderer.sentences import Sentence
from service.errors import Invalid

__all__ = ["is_visible", "plain_note", "plain_title", "safe_name"]

MAX_NAME = 1024
MAX_PART = 255
DRIVE = re.compile(r"^[A-Za-z]:")


def safe_name(name: str) -> str:
    """Returns the path, normalized and with forward slashes. Raises Invalid if it is not relative, unsafe, empty or too long."""
    shown = ascii(name if len(name) <= 120 else name[:117] + "...")
    if not name:
        raise Invalid(Sentence("file-name-missing", "A file has no name. Give every file its name, with folders if it has any."))
    if "\\" in name:
        raise Invalid(
            Sentence(
                "file-name-backslash", "The file name {name} has a backslash. Use forward slashes between folders.", name=shown
            )
        )
    if name.startswith("/") or DRIVE.match(name):
        raise Invalid(
            Sentence(
                "file-name-absolute",
                "The file name {name} is an absolute path. Names are relative to the scene's folder.",
                name=shown,
            )
        )
    if _has_control(name):
        raise Invalid(
            Sentence("file-name-control-characters", "The file name {name} has control characters. Rename the file.", name=shown)
        )
    parts = [part for part in name.split("/") if part not in ("", ".")]
    if ".." in parts:
        raise Invalid(
            Sentence(
                "file-name-outside-upload",
                "The file name {name} leads out of the upload with '..'. Move the file beside the scene.",
                name=shown,
            )
        )
    if not parts:
        raise Invalid(Sentence("file-name-empty", "The file name {name} is empty. Rename the file.", name=shown))
    if len(name.encode()) > MAX_NAME or any(len(part.encode()) > MAX_PART for part in parts):
        raise Invalid(
            Sentence(
                "file-name-too-long",
                "The file name {name} is too long; at most {most_part} bytes per part and {most} in total are allowed.",
                name=shown,
                most_part=MAX_PART,
                most=MAX_NAME,
            )
        )
    return "/".join(parts)


def plain_title(text: str) -> str:
    """Returns the title of a scene or job without surrounding spaces.

    Raises Invalid unless it is one line without control characters.
    """
    text = text.strip()
    if _has_control(text):
        raise Invalid(
            Sentence(
                "name-control-characters",
                "name: {text} has control characters or line breaks. Give it one line of plain text.",
                text=ascii(text[:60]),
            )
        )
    return text


def plain_note(text: str) -> str:
    """Returns the note on a job without surrounding spaces and with line feeds as line ends.

    Raises Invalid if it contains control characters other than line feed and tab.
    """
    text = text.replace("\r\n", "\n").strip()
    if _has_control(text.replace("\n", " ").replace("\t", " ")):
        raise Invalid(
            Sentence(
                "note-control-characters",
                "note: {text} has control characters. Give it lines of plain text.",
                text=ascii(text[:60]),
            )
        )
    return text


def is_visible(text: str) -> bool:
    """Returns True unless a text has only spaces and characters without a shape, such as U+200B."""
    return any(each.isprintable() and not each.isspace() for each in text)


def _has_control(text: str) -> bool:
    return one_line(text) != text
