"""A few threads for what takes much memory and time: whole pictures and digests. More than wait in line are turned away.

Without bounds, each of many readers of a large picture has its own copies of it in memory at the same time, and they take
the threads of all other requests.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import anyio
import anyio.to_thread

from service.errors import Unavailable

__all__ = ["Pool"]

THREADS = max(2, min(4, (os.cpu_count() or 2) // 2))
IN_LINE = 128

T = TypeVar("T")


class Pool:
    """Used on the event loop alone. Readers who ask for the same at the same time share one answer."""

    def __init__(self, threads: int = THREADS, in_line: int = IN_LINE) -> None:
        self._limiter = anyio.CapacityLimiter(threads)
        self._most = threads + in_line
        self._made: dict[Hashable, asyncio.Task[Any]] = {}

    @property
    def asked(self) -> int:
        """How many different things are asked for and not made yet."""
        return len(self._made)

    async def make(self, key: Hashable, function: Callable[..., T], *arguments: Any) -> T:
        """function(*arguments), in a thread when its turn comes. Raises Unavailable where the line is too long."""
        task: asyncio.Task[T] | None = self._made.get(key)
        if task is None:
            if self.asked >= self._most:
                raise Unavailable(f"{self.asked} other pictures are asked for and not made yet. Try again in a moment.")
            task = self._made[key] = asyncio.create_task(self._run(function, *arguments))
            task.add_done_callback(lambda task: self._done(key, task))
        return await asyncio.shield(task)  # a reader that leaves must not take the picture from those who wait for the same

    async def _run(self, function: Callable[..., T], *arguments: Any) -> T:
        return await anyio.to_thread.run_sync(function, *arguments, limiter=self._limiter)

    def _done(self, key: Hashable, task: asyncio.Task[Any]) -> None:
        del self._made[key]
        if not task.cancelled():
            task.exception()  # it is the readers' to handle; where all have left, it is nobody's
