"""Disk space kept in reserve, so that a deletion can be recorded on a full disk: deleting frees space only after that."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from service.errors import NoRoom
from service.store.whole import PRIVATE

__all__ = ["Reserve"]

SIZE = 1 << 20  # of SQLite's log: the pages that a deletion touches
T = TypeVar("T")

log = logging.getLogger(__name__)


class Reserve:
    """A file of bytes that nobody reads."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def fill(self) -> None:
        """Keep room back, where it is not kept yet and there is some."""
        with contextlib.suppress(OSError):
            if self._path.exists() and self._path.stat().st_size == SIZE:
                return
            with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE), "wb") as file:
                file.write(os.urandom(SIZE))  # no file system packs these to less
                file.flush()
                os.fsync(file.fileno())

    def spend_on(self, deletion: Callable[[], T]) -> T:
        """Run a deletion, and where there is no room for it, give the reserve back and run it again."""
        try:
            return deletion()
        except NoRoom:
            log.warning("the disk is full: the reserve is given to a deletion")
            self._path.unlink(missing_ok=True)
            return deletion()
        finally:
            self.fill()
