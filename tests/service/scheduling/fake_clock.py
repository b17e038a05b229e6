"""A clock that tests set."""

from __future__ import annotations

__all__ = ["FakeClock"]


class FakeClock:
    """The wall and this thread's processor, which works all the time."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    thread_time = monotonic
