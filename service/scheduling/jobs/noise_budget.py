"""Limit on the processor time for noise estimates that are only displayed.

Estimating a tile's noise reads all its sums, which takes milliseconds, and on a farm of thousands of slots a hundred tiles may
quadruple their samples at once. So these estimates get a fixed fraction of the engine's time. Between two estimates of a tile,
its noise is extrapolated from its number of samples.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from service.clock import WorkClock

__all__ = ["NoiseBudget"]

SHARE = 0.01  # of a core
AT_ONCE_S = 0.3  # seconds that can be accumulated, so that a small picture gets its noise at once


class NoiseBudget:
    """Processor time available for noise estimates. Used only by the engine's thread."""

    def __init__(self, clock: WorkClock = time) -> None:
        self._clock = clock
        self._left_s = AT_ONCE_S
        self._since = self._clock.monotonic()

    def has_time(self) -> bool:
        """Returns True if there is time for another estimate."""
        now = self._clock.monotonic()
        self._left_s = min(self._left_s + SHARE * (now - self._since), AT_ONCE_S)
        self._since = now
        return self._left_s > 0.0

    @contextmanager
    def charged(self) -> Iterator[None]:
        """Context manager that deducts the processor time of its block from the available time."""
        begun = self._clock.thread_time()
        try:
            yield
        finally:
            self._left_s -= self._clock.thread_time() - begun
