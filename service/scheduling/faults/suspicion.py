"""Which workers fail where others do not: a full disk, a wrong library, a machine that miscalculates."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Hashable
from itertools import count

__all__ = ["Suspicion"]

FORGIVENESS = 0.02  # failures a success makes up for: what fails once in fifty batches is not set aside


class Suspicion:
    """Counts failures that are a worker's own. Lives in the engine's thread.

    Those are batches that failed there and were rendered by another; and different batches that failed one after the other
    without a success between, while another had one: a worker that fails at once would else take all that is to do.
    """

    def __init__(self) -> None:
        self._made_good: defaultdict[str, float] = defaultdict(float)
        self._row: defaultdict[str, set[Hashable]] = defaultdict(set)
        self._row_began: dict[str, int] = {}
        self._success: dict[str, int] = {}
        self._clock = count()
        self._misunderstood: Counter[str] = Counter()  # since its last success
        self.failures: Counter[str] = Counter()  # of all batches, by worker, whoever was to blame

    def failed(self, worker: str, batch: Hashable) -> None:
        """A batch failed on a worker."""
        self.failures[worker] += 1
        if not self._row[worker]:
            self._row_began[worker] = next(self._clock)
        self._row[worker].add(batch)

    def misunderstood(self, worker: str) -> int:
        """A worker did not understand a batch; how many it did not, one after the other."""
        self._misunderstood[worker] += 1
        return self._misunderstood[worker]

    def succeeded(self, worker: str, failed_on: list[str]) -> None:
        """A worker rendered a batch that had failed on these before: so the batch was not to blame."""
        for other in set(failed_on) - {worker}:
            self._made_good[other] += 1
        self._success[worker] = next(self._clock)
        self._row.pop(worker, None)
        self._misunderstood.pop(worker, None)
        if worker in self._made_good:
            self._made_good[worker] = max(self._made_good[worker] - FORGIVENESS, 0.0)

    def of(self, worker: str, others: list[str]) -> int:
        """How many failures are a worker's own, in comparison with these others."""
        in_a_row = self._row.get(worker, set())
        others_can = any(self._success.get(other, -1) > self._row_began.get(worker, 0) for other in others)
        return max(int(self._made_good.get(worker, 0.0)), len(in_a_row) if others_can else 0)

    def forgive(self, worker: str) -> None:
        """A person lets the worker go on."""
        for counted in (self._made_good, self._row, self._misunderstood):
            counted.pop(worker, None)
