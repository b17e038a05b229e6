"""Files that are written whole or not at all, whatever happens in between: also a power cut."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["PRIVATE", "PRIVATE_FOLDER", "make_private", "move_whole", "write_once", "write_whole"]

PRIVATE = 0o600  # what the service keeps is its user's alone
PRIVATE_FOLDER = 0o700


def make_private(folder: Path) -> None:
    """Make a folder, and those above it that are not there, for their owner alone."""
    if not folder.is_dir():
        make_private(folder.parent)
        folder.mkdir(PRIVATE_FOLDER, exist_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write a small file; another process sees the old content or the new one."""
    with _beside(path, data) as temporary:
        move_whole(temporary, path)


def write_once(path: Path, data: bytes) -> None:
    """Write a small file where there is none: of several processes that do so at once one does, and all read the same."""
    with _beside(path, data) as temporary:
        _sync(temporary)
        try:
            path.hardlink_to(temporary)
        except FileExistsError:
            return
        except OSError:  # a file system without links
            temporary.replace(path)
        _sync(path.parent)


@contextmanager
def _beside(path: Path, data: bytes) -> Iterator[Path]:
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE), "wb") as file:
            file.write(data)
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def move_whole(temporary: Path, path: Path) -> None:
    """Give a written file its name. First its bytes reach the disk, then the name does: a name never stands for less."""
    _sync(temporary)
    temporary.replace(path)
    _sync(path.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
