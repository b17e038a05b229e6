"""A simulated clock, whose time is set by tests."""

from __future__ import annotations

__all__ = ["FakeClock"]


class FakeClock:
    """A simulated clock: wall time, and processor time of a thread that is always busy."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    thread_time = monotonic
