"""What workers rendered of one batch, and who is right: the value on which two workers agree. No clock, no queue."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from protocol.sums import unpack_sums
from renderer.settings import Tile

__all__ = ["Votes"]

ASKED_AT_MOST = 2  # answers of one worker, where others may give some


@dataclass
class Votes:
    """Of one batch, by worker. Values that are equal to the bit are one."""

    tile: Tile
    values: list[bytes] = field(default_factory=list)  # packed sums, each other than those before it
    cast: list[tuple[str, int]] = field(default_factory=list)  # by whom, for which of the values

    def add(self, worker: str, sums: bytes) -> None:
        """A worker's answer. Raises ValueError where it is none."""
        known = (number for number, value in enumerate(self.values) if self._is_equal(value, sums))
        if (found := next(known, None)) is None:
            unpack_sums(sums, self.tile)
            found = len(self.values)
            self.values.append(sums)
        self.cast.append((worker, found))

    def take_back(self, worker: str) -> None:
        """Whatever it has said means nothing."""
        self.cast = [vote for vote in self.cast if vote[0] != worker]

    @property
    def workers(self) -> set[str]:
        """Who has answered."""
        return {worker for worker, _ in self.cast}

    @property
    def differ(self) -> bool:
        """Whether there are answers other than the first."""
        return len({value for _, value in self.cast}) > 1

    @property
    def right(self) -> int | None:
        """The value on which two workers agree; None while there is none."""
        supporters: dict[int, set[str]] = {}
        for worker, value in self.cast:
            supporters.setdefault(value, set()).add(worker)
        best = max(supporters, key=lambda value: len(supporters[value]), default=None)
        return best if best is not None and len(supporters[best]) > 1 else None

    @property
    def wrong(self) -> set[str]:
        """Who has answered otherwise, be it once; nobody while it is not known what is right."""
        right = self.right
        return set() if right is None else {worker for worker, value in self.cast if value != right}

    def may_help(self, ready: set[str]) -> bool:
        """Whether some of these workers can still say something new."""
        answers = Counter(worker for worker, _ in self.cast)
        return any(answers[worker] < ASKED_AT_MOST for worker in ready) and len(ready | self.workers) > 1

    def _is_equal(self, value: bytes, sums: bytes) -> bool:
        """The same sums may be packed by releases of LZ4 that find other bytes for them."""
        return value == sums or np.array_equal(unpack_sums(value, self.tile), unpack_sums(sums, self.tile))
