"""The lock of a data folder: acquiring it proves that its previous holder has ended."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import IO

from service.store.atomic_files import PRIVATE

__all__ = ["FolderLock"]


class FolderLock:
    """A file lock of this process, released by the system when the process ends."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "service.lock"
        self._file: IO[str] | None = None

    @property
    def is_held(self) -> bool:
        """True if this process holds it."""
        return self._file is not None

    def attempt(self) -> bool:
        """Acquires the lock if it is free; returns whether it is held. On a file system without locks it is never held."""
        if self._file is None:
            file = os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, PRIVATE), "w")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.close()
            else:
                self._file = file
        return self._file is not None

    def release(self) -> None:
        """Releases the lock."""
        if self._file is not None:
            self._file.close()
            self._file = None
