"""Timeouts for a farm on a busy machine: only time in which none of the farm's processes ran or waited for a processor counts."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

import psutil

__all__ = ["Patience", "children"]

MOST = 8.0  # limit in wall time, as a multiple, since a farm may be busy for ever
LOOKS_EVERY_S = 1.0


class Patience:
    """A timeout over idle time since its creation. Without /proc, which has the waiting times of threads, all time counts."""

    def __init__(self, seconds: float, processes: Callable[[], list[int]], now: Callable[[], float] = time.monotonic) -> None:
        """seconds: idle time until the timeout. processes: returns the current process ids."""
        self._seconds = seconds
        self._processes = processes
        self._now = now
        self._idle = 0.0
        self._begun = self._looked = now()
        self._before = self._busy()

    @property
    def is_over(self) -> bool:
        """Returns True if the timeout has passed."""
        now = self._now()
        if now - self._looked >= LOOKS_EVERY_S:
            busy = self._busy()
            most = max((seconds - self._before.get(thread, 0.0) for thread, seconds in busy.items()), default=0.0)
            self._idle += max(0.0, now - self._looked - most)
            self._looked, self._before = now, busy
        return self._idle > self._seconds or now - self._begun > MOST * self._seconds

    def _busy(self) -> dict[int, float]:
        """Returns, by thread id, the seconds for which each thread of the processes has run or waited for a processor."""
        found = {}
        for process in self._processes():
            for thread in Path(f"/proc/{process}/task").glob("*"):
                with contextlib.suppress(OSError, ValueError):
                    used, waited, _ = (thread / "schedstat").read_text().split()
                    found[int(thread.name)] = (int(used) + int(waited)) / 1e9
        return found


def children() -> list[int]:
    """Returns the process ids of all descendants of this process."""
    return [process.pid for process in psutil.Process().children(recursive=True)]
