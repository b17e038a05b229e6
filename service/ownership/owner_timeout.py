"""Decides when an owner that does not answer is considered dead."""

from __future__ import annotations

import math
from collections.abc import Callable

from service.store.models import FarmOwner

__all__ = ["MIN_CHECKS", "OwnerTimeout"]

MIN_CHECKS = 4  # checks of the row; a candidate that was suspended itself must not mistake that for the owner's silence


class OwnerTimeout:
    """Measures how long the owner has not answered.

    Uses this process's monotonic clock, since clocks differ between machines and can jump.
    """

    def __init__(self, lease_s: float, clock: Callable[[], float]) -> None:
        self._lease_s = lease_s
        self._clock = clock
        self._epoch = 0
        self._number: int | None = None
        self._since = math.inf
        self._looks = 0

    def record_request(self, epoch: int, number: int) -> None:
        """Records that request `number` was sent just now to the owner with this epoch (the number of its term of ownership)."""
        self._epoch, self._number = epoch, number
        self._since, self._looks = self._clock(), 0

    def has_answered(self, row: FarmOwner) -> bool:
        """Returns True if the owner has answered the recorded request."""
        return self._number is not None and row.epoch == self._epoch and row.answered >= self._number

    def is_request_due(self, row: FarmOwner) -> bool:
        """Returns True if a new request must be sent: the owner has answered the last one, or another service is now the owner.

        Must be called once per check.
        """
        if self._number is None or row.epoch != self._epoch or self.has_answered(row):
            return True
        self._looks += 1
        return False

    @property
    def has_expired(self) -> bool:
        """Returns True if the owner has not answered for so long that it is considered dead."""
        return self._looks >= MIN_CHECKS and self._clock() - self._since > self._lease_s
