"""A thread pool for compiled code that runs without the GIL, and the division of a range into parts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self, TypeVar

__all__ = ["PART", "Team", "cores", "parts_of"]

PART = 1 << 16  # vertices or triangles per part: some tenths of a millisecond's work

_Part = TypeVar("_Part")
_Result = TypeVar("_Result")


def cores() -> int:
    """Returns the number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def parts_of(first: int, end: int, size: int) -> list[tuple[int, int]]:
    """Returns the range first ... end - 1 divided into parts (start, end) of `size`, the last smaller.

    The parts must not depend on the number of threads, so that results do not.
    """
    return [(at, min(at + size, end)) for at in range(first, end, size)]


class Team:
    """A thread pool of fixed size, reused between jobs; a context manager. threads: None for one per core."""

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads or cores()
        self._pool: ThreadPoolExecutor | None = None

    def each(self, work: Callable[[_Part], _Result], parts: Iterable[_Part]) -> list[_Result]:
        """Returns the results of `work` for each part, in order.

        Parts are started in order; a single part runs in the calling thread.
        """
        parts = list(parts)
        if self.threads == 1 or len(parts) < 2:
            return [work(part) for part in parts]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="team")
        return list(self._pool.map(work, parts))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> Any:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
