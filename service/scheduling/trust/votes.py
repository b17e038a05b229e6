"""Results of several workers for one batch. A result that two workers agree on is correct. Independent of clocks and queues.

Workers over HTTPS that share a token have one vote together, since the token's owner can start any number of workers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from protocol.channel import token_of
from protocol.sums import unpack_deep, unpack_hits, unpack_sums
from renderer.cryptomatte import no_hits
from renderer.deep import no_deep
from renderer.settings import Tile

__all__ = ["Votes", "voters_among"]

MAX_RESULTS_PER_WORKER = 2  # results per worker, if others are available


@dataclass
class Votes:
    """The results for one batch, by worker. Results with equal sums count as one value."""

    tile: Tile
    values: list[bytes] = field(default_factory=list)  # distinct packed sums
    cast: list[tuple[str, int]] = field(default_factory=list)  # (worker, index of the value)

    def add(self, worker: str, sums: bytes) -> None:
        """Adds a worker's result. sums: packed. Raises ValueError if they cannot be decoded."""
        known = (number for number, value in enumerate(self.values) if self._is_equal(value, sums))
        if (found := next(known, None)) is None:
            unpack_sums(sums, self.tile)
            found = len(self.values)
            self.values.append(sums)
        self.cast.append((worker, found))

    def remove_worker(self, worker: str) -> None:
        """Removes all results of a worker."""
        self.cast = [vote for vote in self.cast if vote[0] != worker]

    @property
    def workers(self) -> set[str]:
        """Names of the workers that returned a result."""
        return {worker for worker, _ in self.cast}

    @property
    def voters(self) -> set[str]:
        """The workers that returned a result, as `voters_among` counts them."""
        return voters_among(self.workers)

    @property
    def has_differences(self) -> bool:
        """True if there is more than one distinct value."""
        return len({value for _, value in self.cast}) > 1

    @property
    def agreed_index(self) -> int | None:
        """Index of the value that two workers agree on; None if there is none."""
        supporters: dict[int, set[str]] = {}
        for worker, value in self.cast:
            supporters.setdefault(value, set()).add(token_of(worker))
        best = max(supporters, key=lambda value: len(supporters[value]), default=None)
        return best if best is not None and len(supporters[best]) > 1 else None

    @property
    def outvoted_workers(self) -> set[str]:
        """Names of the workers whose value is not the correct one; empty while no value is known to be correct."""
        right = self.agreed_index
        return set() if right is None else {worker for worker, value in self.cast if value != right}

    def could_decide(self, ready: set[str]) -> bool:
        """Returns True if a further result of any worker in `ready` could decide which value is correct."""
        answers = Counter(worker for worker, _ in self.cast)
        return any(answers[worker] < MAX_RESULTS_PER_WORKER for worker in ready) and len(voters_among(ready) | self.voters) > 1

    def _is_equal(self, value: bytes, sums: bytes) -> bool:
        """Returns True if two packed results have equal sums. Different LZ4 releases may compress equal sums differently."""
        if value == sums:
            return True
        hits = (unpack_hits(each, self.tile) or no_hits() for each in (value, sums))
        deep = (unpack_deep(each, self.tile) or no_deep(0) for each in (value, sums))
        same_counts = all(map(np.array_equal, *hits)) and all(map(np.array_equal, *deep))
        return same_counts and np.array_equal(unpack_sums(value, self.tile), unpack_sums(sums, self.tile))


def voters_among(workers: Iterable[str]) -> set[str]:
    """Returns the workers whose results count separately: their names, or the token's id for workers over HTTPS."""
    return set(map(token_of, workers))
