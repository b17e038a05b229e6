"""Reserved disk space. A deletion frees space only after it was recorded, so recording it must work on a full disk."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from service.errors import OutOfSpace
from service.store.atomic_files import PRIVATE

__all__ = ["Reserve"]

SIZE = 1 << 20  # bytes, enough for SQLite's log of the pages that a deletion changes
T = TypeVar("T")

log = logging.getLogger(__name__)


class Reserve:
    """A file of unused bytes, which is deleted when its space is needed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def refill(self) -> None:
        """Writes the reserve file if it is missing and the disk has space for it."""
        with contextlib.suppress(OSError):
            if self._path.exists() and self._path.stat().st_size == SIZE:
                return
            with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE), "wb") as file:
                file.write(os.urandom(SIZE))  # not compressible by the file system
                file.flush()
                os.fsync(file.fileno())

    def run_deletion(self, deletion: Callable[[], T]) -> T:
        """Runs `deletion` and returns its result. If the disk is full, deletes the reserve file and runs it again.

        The reserve file is written again afterwards.
        """
        try:
            return deletion()
        except OutOfSpace:
            log.warning("the disk is full: the reserved space is released for a deletion")
            self._path.unlink(missing_ok=True)
            return deletion()
        finally:
            self.refill()
