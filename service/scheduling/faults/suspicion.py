"""Detects workers that fail where others succeed: because of a full disk, a wrong library, or wrong arithmetic."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Hashable
from itertools import count

__all__ = ["Suspicion"]

FORGIVEN_PER_SUCCESS = 0.02  # failures cancelled by one success, so one failure in fifty batches is tolerated


class Suspicion:
    """Counts the failures that are attributed to each worker. Used only by the engine's thread.

    A failure is attributed to a worker if another worker then rendered the batch. Successive failures of different batches are
    also attributed if another worker succeeded meanwhile. Otherwise a worker that fails at once would fetch all the work.
    """

    def __init__(self) -> None:
        self._made_good: defaultdict[str, float] = defaultdict(float)
        self._row: defaultdict[str, set[Hashable]] = defaultdict(set)
        self._row_began: dict[str, int] = {}
        self._success: dict[str, int] = {}
        self._clock = count()
        self._misunderstood: Counter[str] = Counter()  # since its last success
        self.failures: Counter[str] = Counter()  # all failed batches, by worker, whatever the cause

    def record_failure(self, worker: str, batch: Hashable) -> None:
        """Records that a batch failed on a worker."""
        self.failures[worker] += 1
        if not self._row[worker]:
            self._row_began[worker] = next(self._clock)
        self._row[worker].add(batch)

    def record_misunderstood(self, worker: str) -> int:
        """Records that a worker did not understand a batch. Returns how often this has happened since its last success."""
        self._misunderstood[worker] += 1
        return self._misunderstood[worker]

    def record_success(self, worker: str, failed_on: list[str]) -> None:
        """Records that a worker rendered a batch, and attributes earlier failures of the batch to the workers `failed_on`."""
        for other in set(failed_on) - {worker}:
            self._made_good[other] += 1
        self._success[worker] = next(self._clock)
        self._row.pop(worker, None)
        self._misunderstood.pop(worker, None)
        if worker in self._made_good:
            self._made_good[worker] = max(self._made_good[worker] - FORGIVEN_PER_SUCCESS, 0.0)

    def failures_of(self, worker: str, others: list[str]) -> int:
        """Returns the number of failures attributed to a worker. others: the workers with which it is compared."""
        in_a_row = self._row.get(worker, set())
        others_can = any(self._success.get(other, -1) > self._row_began.get(worker, 0) for other in others)
        return max(int(self._made_good.get(worker, 0.0)), len(in_a_row) if others_can else 0)

    def clear_failures(self, worker: str) -> None:
        """Clears a worker's failures after a user has resumed it."""
        for counted in (self._made_good, self._row, self._misunderstood):
            counted.pop(worker, None)
