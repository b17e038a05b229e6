"""A priority queue with frequently changing priorities.

Outdated entries stay in the heap and are skipped, so a change takes logarithmic time.
"""

from __future__ import annotations

import heapq
from typing import Any, Generic, Protocol, TypeVar

__all__ = ["MAX_OUTDATED", "LazyHeap"]

MAX_OUTDATED = 64  # outdated entries before the heap is rebuilt


class Comparable(Protocol):
    """Interface of values that can be compared with `<`."""

    def __lt__(self, other: Any, /) -> bool: ...


Priority = TypeVar("Priority", bound=Comparable)


class LazyHeap(Generic[Priority]):
    """Integer keys sorted by priority, then by key. A priority is any comparable value; the smallest comes first."""

    def __init__(self) -> None:
        self._heap: list[tuple[Priority, int]] = []
        self._priorities: dict[int, Priority] = {}

    def __len__(self) -> int:
        return len(self._priorities)

    def put(self, key: int, priority: Priority) -> None:
        """Adds a key with this priority, or changes its priority."""
        if self._priorities.get(key) != priority:
            self._priorities[key] = priority
            heapq.heappush(self._heap, (priority, key))
            if len(self._heap) > 2 * len(self._priorities) + MAX_OUTDATED:
                self._heap = [(priority, key) for key, priority in self._priorities.items()]
                heapq.heapify(self._heap)

    def drop(self, key: int) -> None:
        """Removes a key if it is present."""
        self._priorities.pop(key, None)

    def smallest(self) -> tuple[Priority, int] | None:
        """Returns the smallest priority with its key; None if the heap is empty."""
        while self._heap and not self._is_current(self._heap[0]):
            heapq.heappop(self._heap)
        return self._heap[0] if self._heap else None

    def first_keys(self, max_count: int) -> list[int]:
        """Returns the first keys in order, at most `max_count`."""
        taken: dict[int, tuple[Priority, int]] = {}
        while len(taken) < max_count and (first := self.smallest()) is not None:
            taken[first[1]] = heapq.heappop(self._heap)
        for entry in taken.values():
            heapq.heappush(self._heap, entry)
        return list(taken)

    def count_before(self, priority: Priority, max_count: int) -> int:
        """Returns the number of keys with a smaller priority than `priority`, at most `max_count`."""
        found: set[int] = set()
        look = [0]
        while look and len(found) < max_count:
            at = look.pop()
            if at < len(self._heap) and self._heap[at][0] < priority:
                if self._is_current(self._heap[at]):
                    found.add(self._heap[at][1])
                look += (2 * at + 1, 2 * at + 2)
        return len(found)

    def _is_current(self, entry: tuple[Priority, int]) -> bool:
        return self._priorities.get(entry[1]) == entry[0]
