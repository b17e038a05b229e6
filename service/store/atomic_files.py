"""Atomic file writes: a file is complete or absent, even after a power failure."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["PRIVATE", "PRIVATE_FOLDER", "make_private", "rename_synced", "write_atomically", "write_if_missing"]

PRIVATE = 0o600  # modes of the service's files and folders: accessible to their owner only
PRIVATE_FOLDER = 0o700


def make_private(folder: Path) -> None:
    """Creates a folder and its missing parents, accessible only to their owner."""
    if not folder.is_dir():
        make_private(folder.parent)
        folder.mkdir(PRIVATE_FOLDER, exist_ok=True)


def write_atomically(path: Path, data: bytes) -> None:
    """Writes a small file atomically: other processes see either the old or the new content."""
    with _temporary_beside(path, data) as temporary:
        rename_synced(temporary, path)


def write_if_missing(path: Path, data: bytes) -> None:
    """Writes a small file unless it exists.

    If several processes call this at once, one of them writes the file, and all see its content afterwards.
    """
    with _temporary_beside(path, data) as temporary:
        _sync(temporary)
        try:
            path.hardlink_to(temporary)
        except FileExistsError:
            return
        except OSError:  # a file system without hard links
            temporary.replace(path)
        _sync(path.parent)


@contextmanager
def _temporary_beside(path: Path, data: bytes) -> Iterator[Path]:
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE), "wb") as file:
            file.write(data)
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def rename_synced(temporary: Path, path: Path) -> None:
    """Renames a completely written file to its final name.

    Syncs the file to disk first, so that the final name never refers to incomplete content.
    """
    _sync(temporary)
    temporary.replace(path)
    _sync(path.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
