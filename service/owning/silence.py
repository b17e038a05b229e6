"""When an owner that does not answer counts as dead."""

from __future__ import annotations

import math
from collections.abc import Callable

from service.store.models import Owner

__all__ = ["LEAST_LOOKS", "Silence"]

LEAST_LOOKS = 4  # at the row, so that a service which stood still itself does not take its own silence for the owner's


class Silence:
    """How long the owner has not answered, by this process's monotonic clock alone: clocks of machines differ and jump."""

    def __init__(self, lease_s: float, clock: Callable[[], float]) -> None:
        self._lease_s = lease_s
        self._clock = clock
        self._epoch = 0
        self._number: int | None = None
        self._since = math.inf
        self._looks = 0

    def asked(self, epoch: int, number: int) -> None:
        """Records that the owner of this epoch was asked just now, with this number."""
        self._epoch, self._number = epoch, number
        self._since, self._looks = self._clock(), 0

    def has_answered(self, row: Owner) -> bool:
        """Whether the owner that was asked has answered."""
        return self._number is not None and row.epoch == self._epoch and row.answered >= self._number

    def is_broken(self, row: Owner) -> bool:
        """Whether the owner has answered or is a new one that has to be asked. Called once per check."""
        if self._number is None or row.epoch != self._epoch or self.has_answered(row):
            return True
        self._looks += 1
        return False

    @property
    def is_too_long(self) -> bool:
        """Whether the farm may be taken over."""
        return self._looks >= LEAST_LOOKS and self._clock() - self._since > self._lease_s
