"""What was changed in the database and the engine has not taken over yet."""

from __future__ import annotations

import queue

__all__ = ["Changes"]

Change = tuple[str, str]  # what ("job", "scene", "worker", "terms") and which


class Changes:
    """Noted by any thread, applied by the engine's. What cannot be applied yet stays noted."""

    def __init__(self) -> None:
        self._new: queue.SimpleQueue[Change] = queue.SimpleQueue()
        self._open: dict[Change, None] = {}

    def note(self, what: str, id: str) -> None:
        """Something was made, changed or deleted."""
        self._new.put((what, id))

    def open(self) -> list[Change]:
        """What is not applied yet, in the order in which it was noted first."""
        while not self._new.empty():
            self._open[self._new.get()] = None
        return list(self._open)

    def is_open(self, change: Change) -> bool:
        """Whether it was looked at, and could not be applied yet."""
        return change in self._open

    def close(self, change: Change) -> None:
        """It is applied, or never will be."""
        self._open.pop(change, None)
