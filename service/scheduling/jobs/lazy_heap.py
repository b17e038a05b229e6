"""Things by a number or a tuple that changes, of which the least is asked for often. What has changed in the meantime stays in
the heap and is passed over, so that a change costs the logarithm of their number."""

from __future__ import annotations

import heapq
from typing import Any, Generic, Protocol, TypeVar

__all__ = ["SLACK", "LazyHeap"]

SLACK = 64  # entries that say what was before


class Ordered(Protocol):
    """What can be compared with its like."""

    def __lt__(self, other: Any, /) -> bool: ...


Place = TypeVar("Place", bound=Ordered)


class LazyHeap(Generic[Place]):
    """Keys, each at its place; of equal places the least key comes first."""

    def __init__(self) -> None:
        self._heap: list[tuple[Place, int]] = []
        self._places: dict[int, Place] = {}

    def __len__(self) -> int:
        return len(self._places)

    def put(self, key: int, place: Place) -> None:
        """It stands there from now on."""
        if self._places.get(key) != place:
            self._places[key] = place
            heapq.heappush(self._heap, (place, key))
            if len(self._heap) > 2 * len(self._places) + SLACK:
                self._heap = [(place, key) for key, place in self._places.items()]
                heapq.heapify(self._heap)

    def drop(self, key: int) -> None:
        """It is not among them any more, if it was."""
        self._places.pop(key, None)

    def first(self) -> tuple[Place, int] | None:
        """The least place, and who stands there; None where nobody does."""
        while self._heap and not self._is_true(self._heap[0]):
            heapq.heappop(self._heap)
        return self._heap[0] if self._heap else None

    def some(self, most: int) -> list[int]:
        """The first of them, in order."""
        taken: dict[int, tuple[Place, int]] = {}
        while len(taken) < most and (first := self.first()) is not None:
            taken[first[1]] = heapq.heappop(self._heap)
        for entry in taken.values():
            heapq.heappush(self._heap, entry)
        return list(taken)

    def before(self, place: Place, most: int) -> int:
        """How many stand before a place; `most` where there are more."""
        found: set[int] = set()
        look = [0]
        while look and len(found) < most:
            at = look.pop()
            if at < len(self._heap) and self._heap[at][0] < place:
                if self._is_true(self._heap[at]):
                    found.add(self._heap[at][1])
                look += (2 * at + 1, 2 * at + 2)
        return len(found)

    def _is_true(self, entry: tuple[Place, int]) -> bool:
        return self._places.get(entry[1]) == entry[0]
