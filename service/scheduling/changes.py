"""Database changes that the engine has not applied yet."""

from __future__ import annotations

import queue
from collections.abc import Iterable
from itertools import islice

__all__ = ["Changes"]

AT_A_TIME = 200  # low-priority changes per step

Change = tuple[str, str]  # kind ("job", "scene", "worker", "terms") and id


class Changes:
    """Queue of changes: any thread adds to it, the engine's thread applies them.

    A change that cannot be applied yet stays in it.
    """

    def __init__(self) -> None:
        self._new: queue.SimpleQueue[Change] = queue.SimpleQueue()
        self._open: dict[Change, None] = {}
        self._later: dict[Change, None] = {}

    def note_later(self, what: str, ids: Iterable[str]) -> None:
        """Adds low-priority changes left by a previous run, applied after current ones. Used only by the engine's thread."""
        self._later |= dict.fromkeys((what, id) for id in ids)

    def note(self, what: str, id: str) -> None:
        """Adds a change: an item was created, modified or deleted."""
        self._new.put((what, id))

    def open(self) -> list[Change]:
        """Returns the pending changes, oldest first, filled up to `AT_A_TIME` with low-priority ones."""
        while not self._new.empty():
            change = self._new.get()
            self._later.pop(change, None)
            self._open[change] = None
        for change in list(islice(self._later, max(AT_A_TIME - len(self._open), 0))):
            del self._later[change]
            self._open[change] = None
        return list(self._open)

    @property
    def is_behind(self) -> bool:
        """True if low-priority changes of a previous run are still unprocessed."""
        return bool(self._later)

    def is_open(self, change: Change) -> bool:
        """Returns True if a change is pending, current or low-priority."""
        return change in self._open or change in self._later

    def close(self, change: Change) -> None:
        """Removes a change that was applied or never will be."""
        self._open.pop(change, None)
