"""The lock of a data folder: getting it proves that whoever held it has ended, however that happened."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import IO

from service.store.whole import PRIVATE

__all__ = ["FolderLock"]


class FolderLock:
    """Of one process. The system lets go of it when that ends."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "service.lock"
        self._file: IO[str] | None = None

    @property
    def is_held(self) -> bool:
        """Whether this process has it."""
        return self._file is not None

    def attempt(self) -> bool:
        """Take it where nobody has it; whether it is held now. A folder that knows no locks is one that is never held."""
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
        """Let others have it."""
        if self._file is not None:
            self._file.close()
            self._file = None
