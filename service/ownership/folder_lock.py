"""Lock on a data folder. Whoever acquires it knows that the previous holder's process has ended."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import IO

from service.store.atomic_files import PRIVATE

__all__ = ["FolderLock"]


class FolderLock:
    """File lock held by this process. The operating system releases it when the process ends."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "service.lock"
        self._file: IO[str] | None = None

    @property
    def is_held(self) -> bool:
        """Returns True if this process holds the lock."""
        return self._file is not None

    def attempt(self) -> bool:
        """Acquires the lock if it is free. Returns True if this process holds it; always False on file systems without locks."""
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
