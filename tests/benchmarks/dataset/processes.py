"""Processor time, memory and files of a farm's processes while it runs."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple, Self

import psutil

__all__ = ["FarmSampler", "Usage"]

EVERY_S = 2.0
FILES_EVERY = 5  # samples
ROLES = ("slots", "readers", "worker", "service", "Redis", "tracing", "supervisor")


class Usage(NamedTuple):
    """A sample. views: complete ones. memory: bytes by role, private and shared; files: bytes on disk by folder."""

    views: int
    memory: dict[str, int]
    files: dict[str, int]


class FarmSampler:
    """Context manager with a thread that samples the process tree of a farm. views: set by the caller."""

    def __init__(self, process: int, folders: dict[str, Path]) -> None:
        self._root = psutil.Process(process)
        self._folders = folders
        self._seconds: dict[tuple[int, float], tuple[str, float]] = {}  # by process: role, processor time
        self._before: dict[str, float] = defaultdict(float)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sampler", daemon=True)
        self._files: dict[str, int] = {}
        self.views = 0
        self.samples: list[Usage] = []
        self.loads: list[float] = []

    def __enter__(self) -> Self:
        self._sample(with_files=True)
        for role, seconds in self._seconds.values():
            self._before[role] += seconds
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._sample(with_files=True)

    def processor_s(self) -> dict[str, float]:
        """Returns the processor seconds of each role since the context was entered."""
        found = {role: -self._before[role] for role in ROLES}
        for role, seconds in self._seconds.values():
            found[role] += seconds
        return found

    def growth(self) -> dict[str, tuple[float, float, float]]:
        """Returns memory and files by name: bytes at half of the views, at the end, and growth per view in between.

        The first half fills caches that have a limit.
        """
        last = self.samples[-1]
        middle = next(sample for sample in self.samples if sample.views >= last.views // 2)
        views = max(last.views - middle.views, 1)
        of = [(f"memory of {role}", middle.memory.get(role, 0), bytes_) for role, bytes_ in last.memory.items()]
        of += [(name, middle.files.get(name, 0), bytes_) for name, bytes_ in last.files.items()]
        return {name: (float(a), float(b), (b - a) / views) for name, a, b in of}

    def _run(self) -> None:
        number = 0
        while not self._stop.wait(EVERY_S):
            number += 1
            self._sample(with_files=number % FILES_EVERY == 0)

    def _sample(self, with_files: bool) -> None:
        memory: dict[str, int] = defaultdict(int)
        worker: set[int] = set()
        for process in [self._root, *self._root.children(recursive=True)]:
            with contextlib.suppress(psutil.Error, OSError):
                role = _role(process, self._root.pid, worker)
                times = process.cpu_times()
                self._seconds[process.pid, process.create_time()] = role, times.user + times.system
                memory[role] += _proportional_bytes(process)
        if with_files:
            self._files = {name: _size(folder) for name, folder in self._folders.items()}
        self.samples.append(Usage(self.views, dict(memory), self._files))
        self.loads.append(os.getloadavg()[0])


def _role(process: psutil.Process, root: int, workers: set[int]) -> str:
    """Returns the role of a process. workers: ids of the workers' main processes, filled as parents come before children."""
    if process.pid == root:
        return "supervisor"
    command = process.cmdline()
    words = " ".join(command[:4])
    if "trace_sender" in words:
        return "tracing"
    if "redis-server" in words or "valkey-server" in words:
        return "Redis"
    if "service" in words:
        return "service"
    if "worker" not in words:
        return "readers"
    if process.ppid() in workers:
        return "slots"
    workers.add(process.pid)
    return "worker"


def _proportional_bytes(process: psutil.Process) -> int:
    """Returns the proportional set size where the system has it, else the resident set size."""
    try:
        return int(process.memory_full_info().pss)
    except (AttributeError, psutil.AccessDenied):
        return int(process.memory_info().rss)


def _size(folder: Path) -> int:
    """Returns the size on disk of a folder's files; some may vanish meanwhile."""
    total = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            total += path.stat().st_blocks * 512
    return total
