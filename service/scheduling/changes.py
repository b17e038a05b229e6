"""What was changed in the database and the engine has not taken over yet."""

from __future__ import annotations

import queue
from collections.abc import Iterable
from itertools import islice

__all__ = ["Changes"]

AT_A_TIME = 200  # of what has time

Change = tuple[str, str]  # what ("job", "scene", "worker", "terms") and which


class Changes:
    """Noted by any thread, applied by the engine's. What cannot be applied yet stays noted."""

    def __init__(self) -> None:
        self._new: queue.SimpleQueue[Change] = queue.SimpleQueue()
        self._open: dict[Change, None] = {}
        self._later: dict[Change, None] = {}

    def note_later(self, what: str, ids: Iterable[str]) -> None:
        """Of an earlier life: applied when there is time left after what changes now. From the engine's thread."""
        self._later |= dict.fromkeys((what, id) for id in ids)

    def note(self, what: str, id: str) -> None:
        """Something was made, changed or deleted."""
        self._new.put((what, id))

    def open(self) -> list[Change]:
        """What is not applied yet, in the order in which it was noted first; of what has time, the next few."""
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
        """Whether something of an earlier life is not looked at yet."""
        return bool(self._later)

    def is_open(self, change: Change) -> bool:
        """Whether it was looked at, and could not be applied yet."""
        return change in self._open or change in self._later

    def close(self, change: Change) -> None:
        """It is applied, or never will be."""
        self._open.pop(change, None)
