"""How long to wait for a farm that may be short of processors: only time in which none of its processes had anything to do is
counted, or was kept waiting for a processor by others.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

import psutil

__all__ = ["Patience", "children"]

MOST = 8.0  # times as long by the clock: a farm that is busy for ever does not come either
LOOKS_EVERY_S = 1.0


class Patience:
    """From its making on. Where the system does not tell of threads what they waited for (no /proc), all time counts."""

    def __init__(self, seconds: float, processes: Callable[[], list[int]], now: Callable[[], float] = time.monotonic) -> None:
        """seconds: without anything to do, that are waited. processes: ids of those that are waited for, as they are then."""
        self._seconds = seconds
        self._processes = processes
        self._now = now
        self._idle = 0.0
        self._begun = self._looked = now()
        self._before = self._busy()

    @property
    def is_over(self) -> bool:
        """True if it was waited for long enough."""
        now = self._now()
        if now - self._looked >= LOOKS_EVERY_S:
            busy = self._busy()
            most = max((seconds - self._before.get(thread, 0.0) for thread, seconds in busy.items()), default=0.0)
            self._idle += max(0.0, now - self._looked - most)
            self._looked, self._before = now, busy
        return self._idle > self._seconds or now - self._begun > MOST * self._seconds

    def _busy(self) -> dict[int, float]:
        """Of each thread: seconds on a processor, or ready and waiting for one."""
        found = {}
        for process in self._processes():
            for thread in Path(f"/proc/{process}/task").glob("*"):
                with contextlib.suppress(OSError, ValueError):
                    used, waited, _ = (thread / "schedstat").read_text().split()
                    found[int(thread.name)] = (int(used) + int(waited)) / 1e9
        return found


def children() -> list[int]:
    """All processes that this one has started, and those that they have."""
    return [process.pid for process in psutil.Process().children(recursive=True)]
