"""How much of the engine's time goes into noise estimates that are only for display.

A tile's noise is computed from all of its sums, which takes milliseconds, and on a farm of thousands of slots a hundred tiles
may quadruple their samples within a moment. So such estimates have to wait for their share of time; until then a tile's noise
is extrapolated from its number of samples.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["Looks"]

SHARE = 0.01  # of a core
AT_ONCE_S = 0.3  # that may have been saved up: a small picture's noise is told at once


class Looks:
    """Lives in the engine's thread."""

    def __init__(self) -> None:
        self._left_s = AT_ONCE_S
        self._since = time.monotonic()

    def may(self) -> bool:
        """Whether there is time for another."""
        now = time.monotonic()
        self._left_s = min(self._left_s + SHARE * (now - self._since), AT_ONCE_S)
        self._since = now
        return self._left_s > 0.0

    @contextmanager
    def one(self) -> Iterator[None]:
        """A look is taken."""
        begun = time.thread_time()
        try:
            yield
        finally:
            self._left_s -= time.thread_time() - begun
