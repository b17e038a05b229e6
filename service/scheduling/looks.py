"""How much of the engine's time goes into looking at noise that nothing but the eye waits for.

A tile's noise is told from all of its sums, which takes milliseconds, and a farm of thousands of slots gives a hundred tiles four
times their samples within a moment. So such looks wait for their share; meanwhile a tile's noise is told by its samples.
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
