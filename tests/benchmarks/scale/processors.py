"""Measures the processor time of each process, and the time that it waited for a processor (Linux, /proc).

These show the bottleneck: a thread that used a processor all the time, or the machine if threads waited for a processor.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import psutil

__all__ = ["Processors", "Share", "family_s", "tree", "written_bytes"]

_Times = dict[int, tuple[float, float]]  # thread id -> seconds on a processor, and seconds waiting for one


class Share(NamedTuple):
    """Processor time of a process, and time for which it waited for a processor, both divided by the wall time.

    The last two fields are the same values for the busiest of its threads.
    """

    used: float
    waited: float
    thread_used: float
    thread_waited: float

    def __str__(self) -> str:
        return (
            f"{self.used:.2f} used, {self.waited:.2f} waited for (of one thread {self.thread_used:.2f}, {self.thread_waited:.2f})"
        )


class Processors:
    """Stopwatch for the processor time of several processes, which starts on construction."""

    def __init__(self, processes: Mapping[str, int]) -> None:
        """processes: process ids by name."""
        self._processes = processes
        self._begun = time.monotonic()
        self._before = {name: _times(pid) for name, pid in processes.items()}

    def shares(self) -> dict[str, Share]:
        """Returns each process's Share since the creation of this object, by name; threads that have ended are left out."""
        seconds = time.monotonic() - self._begun
        found = {}
        for name, pid in self._processes.items():
            before = self._before[name]
            each = [
                ((used - before.get(thread, (0.0, 0.0))[0]) / seconds, (waited - before.get(thread, (0.0, 0.0))[1]) / seconds)
                for thread, (used, waited) in _times(pid).items()
            ]
            busiest = max(each, key=sum, default=(0.0, 0.0))
            found[name] = Share(sum(used for used, _ in each), sum(waited for _, waited in each), *busiest)
        return found


def tree(pid: int | None) -> list[int]:
    """Returns the ids of a process and of all its descendants; an empty list for None."""
    return [] if pid is None else [pid, *(each.pid for each in psutil.Process(pid).children(recursive=True))]


def family_s(pids: Iterable[int]) -> float:
    """Returns the processor seconds of these processes so far, including those of their children that have ended."""
    found = 0.0
    for pid in pids:
        with contextlib.suppress(psutil.NoSuchProcess):
            found += sum(psutil.Process(pid).cpu_times()[:4])  # user, system, and both of ended children
    return found


def written_bytes(pids: Iterable[int]) -> int:
    """Returns how many bytes these processes have written to disks so far."""
    found = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            lines = Path(f"/proc/{pid}/io").read_text().splitlines()
            found += next(int(line.split()[1]) for line in lines if line.startswith("write_bytes:"))
    return found


def _times(pid: int) -> _Times:
    found: _Times = {}
    for thread in Path(f"/proc/{pid}/task").glob("*"):
        with contextlib.suppress(OSError, ValueError):
            used, waited, _ = (thread / "schedstat").read_text().split()
            found[int(thread.name)] = int(used) / 1e9, int(waited) / 1e9
    return found
