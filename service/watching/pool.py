"""A few threads and a memory budget for what takes much memory and time: whole pictures and digests. Requests beyond the length
of the queue are turned away.

Without limits, each of many readers of a large picture would hold copies of it in memory at the same time, and together they
would take the threads of all other requests.
"""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import anyio
import anyio.to_thread

from service.errors import Unavailable
from service.watching.memory import give_back

__all__ = ["Pool"]

THREADS = max(2, min(4, (os.cpu_count() or 2) // 2))
IN_LINE = 64
MOST_RETRY_S = 60.0

T = TypeVar("T")


class Pool:
    """Used on the event loop alone. Readers who ask for the same at the same time share one answer."""

    def __init__(self, memory: int, threads: int = THREADS, in_line: int = IN_LINE) -> None:
        """memory: bytes that all together may take at a time. What says that it takes more is made alone."""
        self._turns = _Turns(threads, memory)
        self._limiter = anyio.CapacityLimiter(threads)
        self._threads = threads
        self._most = threads + in_line
        self._made: dict[Hashable, asyncio.Task[Any]] = {}
        self._seconds = 0.0  # that the latest took, on the average

    @property
    def asked(self) -> int:
        """How many different things are asked for and not made yet."""
        return len(self._made)

    async def make(self, key: Hashable, memory: int, function: Callable[..., T], *arguments: Any) -> T:
        """function(*arguments), in a thread when its turn comes. memory: the most bytes that it takes meanwhile.

        Raises Unavailable where the line is too long.
        """
        task: asyncio.Task[T] | None = self._made.get(key)
        if task is None:
            if self.asked >= self._most:
                raise Unavailable(
                    f"{self.asked} other pictures are asked for and not made yet. Try again in a moment.",
                    retry_after_s=min(math.ceil(self.asked * self._seconds / self._threads) + 1, MOST_RETRY_S),
                )
            task = self._made[key] = asyncio.create_task(self._run(memory, function, *arguments))
            task.add_done_callback(lambda task: self._done(key, task))
        return await asyncio.shield(task)  # a reader that leaves must not take the picture from those who wait for the same

    async def _run(self, memory: int, function: Callable[..., T], *arguments: Any) -> T:
        taken = await self._turns.take(memory)
        begun = time.monotonic()
        try:
            return await anyio.to_thread.run_sync(function, *arguments, limiter=self._limiter)
        finally:
            self._turns.give(taken)
            self._seconds += (time.monotonic() - begun - self._seconds) / 4
            if self.asked == 1:  # the last for now
                await anyio.to_thread.run_sync(give_back, limiter=self._limiter)

    def _done(self, key: Hashable, task: asyncio.Task[Any]) -> None:
        del self._made[key]
        if not task.cancelled():
            task.exception()  # it is the readers' to handle; where all have left, it is nobody's


class _Turns:
    """Threads and bytes, given out in the order in which they are asked for."""

    def __init__(self, threads: int, memory: int) -> None:
        self._threads = threads
        self._memory = self._all = memory
        self._waiting: deque[tuple[int, asyncio.Future[None]]] = deque()

    async def take(self, memory: int) -> int:
        """Wait for a turn; what `give` is to be told."""
        memory = min(memory, self._all)
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((memory, turn))
        self._next()
        await turn
        return memory

    def give(self, memory: int) -> None:
        """The turn is over."""
        self._threads += 1
        self._memory += memory
        self._next()

    def _next(self) -> None:
        while self._waiting and self._threads and self._memory >= self._waiting[0][0]:
            memory, turn = self._waiting.popleft()
            if not turn.cancelled():
                self._threads -= 1
                self._memory -= memory
                turn.set_result(None)
