"""Threads and a memory budget for pictures and digests. Requests beyond the length of the queue are refused.

Without limits, each of many clients of a large picture would hold copies of it in memory at the same time, and together they
would occupy the threads of all other requests.
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
    """A queue of expensive work, used on the event loop only. Concurrent requests for the same key share one result."""

    def __init__(self, memory: int, threads: int = THREADS, in_line: int = IN_LINE) -> None:
        """memory: budget in bytes. Work that needs more runs alone."""
        self._turns = _Turns(threads, memory)
        self._limiter = anyio.CapacityLimiter(threads)
        self._threads = threads
        self._most = threads + in_line
        self._made: dict[Hashable, asyncio.Task[Any]] = {}
        self._seconds = 0.0  # running average of the latest durations

    @property
    def asked(self) -> int:
        """Number of different keys that are queued or running."""
        return len(self._made)

    async def make(self, key: Hashable, memory: int, function: Callable[..., T], *arguments: Any) -> T:
        """Runs function(*arguments) in a thread when its turn comes; returns the result. memory: its estimated peak, in bytes.

        Raises Unavailable if the queue is full.
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
        return await asyncio.shield(task)  # a client that leaves does not cancel it for others

    async def _run(self, memory: int, function: Callable[..., T], *arguments: Any) -> T:
        taken = await self._turns.take(memory)
        begun = time.monotonic()
        try:
            return await anyio.to_thread.run_sync(function, *arguments, limiter=self._limiter)
        finally:
            self._turns.give(taken)
            self._seconds += (time.monotonic() - begun - self._seconds) / 4
            if self.asked == 1:  # the queue is empty after it
                await anyio.to_thread.run_sync(give_back, limiter=self._limiter)

    def _done(self, key: Hashable, task: asyncio.Task[Any]) -> None:
        del self._made[key]
        if not task.cancelled():
            task.exception()  # retrieved, so that one without clients is not reported as unhandled


class _Turns:
    """Threads and bytes, granted in the order of requests."""

    def __init__(self, threads: int, memory: int) -> None:
        self._threads = threads
        self._memory = self._all = memory
        self._waiting: deque[tuple[int, asyncio.Future[None]]] = deque()

    async def take(self, memory: int) -> int:
        """Waits for a turn, and returns what `give` expects."""
        memory = min(memory, self._all)
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((memory, turn))
        self._next()
        await turn
        return memory

    def give(self, memory: int) -> None:
        """Ends a turn."""
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
