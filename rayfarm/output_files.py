"""Writes pictures atomically, and checks before rendering that it will be possible."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from rayfarm.errors import CommandError
from renderer.errors import SettingsError

__all__ = ["check_still_size", "check_writable", "write"]


def check_still_size(output: Path, width: int, height: int) -> None:
    """Raises CommandError if a picture of this size, in pixels, is too small for the file's format."""
    from renderer.image.hdr_still import check_size

    try:
        check_size(output.suffix.lower().lstrip("."), width, height)
    except SettingsError as error:
        raise CommandError(str(error)) from None


def check_writable(output: Path) -> None:
    """Raises CommandError if a file of this name cannot be written."""
    try:
        if not output.parent.is_dir():
            raise CommandError(f"There is no folder {output.parent} to write {output.name} to. Make it first.")
        if output.is_dir():
            raise CommandError(f"{output} is a folder. Name a file in it.")
        if output.exists():
            with output.open("ab"):
                pass
        else:
            with tempfile.NamedTemporaryFile(dir=output.resolve().parent, prefix=f".{output.name[:100]}."):
                pass
    except OSError as error:
        raise CommandError(f"{output} cannot be written ({error.strerror}). Name another file or folder with -o.") from error


def write(output: Path, data: bytes) -> None:
    """Writes a file atomically. Raises CommandError."""
    try:
        try:
            _write_atomically(output.resolve(), data)
        except PermissionError:
            output.write_bytes(data)  # the file is writable, but its folder is not
    except OSError as error:
        raise CommandError(f"{output} cannot be written ({error.strerror}, {len(data):,} bytes).") from error


def _write_atomically(target: Path, data: bytes) -> None:
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:100]}.")
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        part.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_current_umask())
        part.replace(target)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _current_umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
