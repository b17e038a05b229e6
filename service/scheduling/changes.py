"""Queue of the database changes that the engine has not applied yet."""

from __future__ import annotations

import queue
from collections.abc import Iterable
from itertools import islice

__all__ = ["Changes"]

AT_A_TIME = 200  # low-priority changes per step

Change = tuple[str, str]  # kind ("job", "scene", "worker", "terms") and id


class Changes:
    """Changed database items. Any thread adds them; the engine's thread applies them.

    A change that cannot be applied yet stays in the queue.
    """

    def __init__(self) -> None:
        self._new: queue.SimpleQueue[Change] = queue.SimpleQueue()
        self._open: dict[Change, None] = {}
        self._later: dict[Change, None] = {}

    def add_low_priority(self, item_kind: str, ids: Iterable[str]) -> None:
        """Adds changes of items of one kind with low priority, such as those of the jobs left by a previous run.

        Used only by the engine's thread.
        """
        self._later |= dict.fromkeys((item_kind, id) for id in ids)

    def add(self, item_kind: str, id: str) -> None:
        """Records that an item was created, modified or deleted. item_kind: "job", "scene", "worker" or "terms"."""
        self._new.put((item_kind, id))

    def pending(self) -> list[Change]:
        """Returns the pending changes in the order in which they were taken from the queue.

        If there are fewer than `AT_A_TIME`, low-priority changes are added up to this number.
        """
        while not self._new.empty():
            change = self._new.get()
            self._later.pop(change, None)
            self._open[change] = None
        for change in list(islice(self._later, max(AT_A_TIME - len(self._open), 0))):
            del self._later[change]
            self._open[change] = None
        return list(self._open)

    @property
    def has_low_priority(self) -> bool:
        """Returns True if low-priority changes are still unprocessed."""
        return bool(self._later)

    def is_pending(self, change: Change) -> bool:
        """Returns True if a change is pending, with normal or low priority."""
        return change in self._open or change in self._later

    def close(self, change: Change) -> None:
        """Removes a change that was applied or can never be applied."""
        self._open.pop(change, None)
