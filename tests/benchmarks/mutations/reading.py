"""Reads damaged files in bounded child processes, each of which reads many files, since forking costs as much as reading.

A file that is neither read nor refused is read again by a separate child, as a worker does; that outcome counts.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.bounded import Bounds, Send, begin, end

__all__ = ["Came", "peak_memory", "read_all", "reset_peak_memory"]

FILES_A_CHILD = 40
_NUMBER = 8


@dataclass(frozen=True)
class Came:
    """Outcome of reading one file.

    number: of the file in the campaign. answer: result of the reading function; None if the child process was lost.
    """

    number: int
    seconds: float
    answer: dict[str, Any] | None


@dataclass
class _Child:
    """A child process that reads one file after the other: it receives a file's number, and answers with a line."""

    slot: int
    child: int
    reading: int
    telling: int
    number: int
    begun: float = 0.0
    files: int = 0
    said: bytes = field(default=b"")

    def tell(self, number: int) -> None:
        self.number, self.begun, self.said = number, time.monotonic(), b""
        self.files += 1
        with contextlib.suppress(BrokenPipeError):
            os.write(self.telling, number.to_bytes(_NUMBER, "little"))


def read_all(numbers: Iterable[int], read: Callable[[int, int], dict[str, Any]], bounds: Bounds, jobs: int) -> Iterator[Came]:
    """Yields the outcome of read(number, slot) for each number, computed by `jobs` parallel child processes.

    slot: index of the child process, below `jobs`, for resources that only one process may use. If a child is lost or exceeds its
    limits, only its current file counts as lost.
    """
    waiting = iter(numbers)
    children: dict[int, _Child] = {}
    free = list(range(jobs))

    def start() -> None:
        while free and (number := next(waiting, None)) is not None:
            child = _begin(read, bounds, free.pop())
            children[child.reading] = child
            child.tell(number)

    try:
        start()
        while children:
            left = min(child.begun for child in children.values()) + bounds.seconds - time.monotonic()
            ready = select.select(list(children), [], [], max(left, 0))[0]
            late = [c.reading for c in children.values() if time.monotonic() - c.begun > bounds.seconds]
            for reading in dict.fromkeys([*ready, *late]):
                child = children[reading]
                data = os.read(reading, 1 << 16) if reading in ready else b""
                child.said += data
                if data and not child.said.endswith(b"\n"):
                    continue
                answer = json.loads(child.said) if data else None
                lost = answer is None or "error" in answer
                yield Came(child.number, time.monotonic() - child.begun, None if lost else answer)
                number = None if lost or child.files >= FILES_A_CHILD else next(waiting, None)
                if number is not None:
                    child.tell(number)
                    continue
                del children[reading]
                free.append(child.slot)
                _end(child)
            start()
    finally:
        for child in children.values():
            _end(child)


def _begin(read: Callable[[int, int], dict[str, Any]], bounds: Bounds, slot: int) -> _Child:
    listening, telling = os.pipe()

    def work(send: Send) -> dict[str, Any]:
        os.close(telling)
        while len(told := os.read(listening, _NUMBER)) == _NUMBER:
            send(read(int.from_bytes(told, "little"), slot))
        return {}

    child, reading = begin(work, Bounds(bounds.memory_bytes, bounds.seconds * FILES_A_CHILD, bounds.faults, bounds.subject))
    os.close(listening)
    return _Child(slot, child, reading, telling, -1)


def _end(child: _Child) -> None:
    os.close(child.telling)
    end(child.child, child.reading, True)


def reset_peak_memory() -> None:
    """Resets this process' peak resident memory, if the kernel supports it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory() -> int:
    """Returns this process' peak resident memory in bytes since the reset."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0
