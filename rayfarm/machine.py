"""What the commands that keep processes running need of this machine."""

from __future__ import annotations

import os
import signal
from types import FrameType

__all__ = ["StopSignals", "cores"]


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class StopSignals:
    """Ctrl-C, SIGTERM and SIGHUP, counted: the first asks to stop, the second to stop at once."""

    def __init__(self) -> None:
        self.count = 0
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._take)

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.count += 1

    def stop(self) -> bool:
        """Whether to stop."""
        return self.count >= 1

    def hurry(self) -> bool:
        """Whether to stop at once."""
        return self.count >= 2
