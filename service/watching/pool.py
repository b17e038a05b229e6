"""Thread pool with a memory budget, for pictures and digests. Each user has a queue; the queues are served in turn.

A user's requests beyond the queue's limit are rejected. Without limits, many clients that request a large picture would each
hold a copy in memory at the same time, and would occupy the threads of all other requests.
"""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import anyio
import anyio.to_thread

from renderer.sentences import Sentence
from service.errors import Unavailable
from service.watching.allocator import trim_heap

__all__ = ["Pool"]

THREADS = max(2, min(4, (os.cpu_count() or 2) // 2))
QUEUE_LENGTH = 64  # queue length of one user, however long the work takes
MAX_QUEUE_LENGTH = 512  # queue length of one user if the expected wait is below LONGEST_WAIT_S
LONGEST_WAIT_S = 30.0  # shorter than the read timeouts of common proxies
MAX_TOTAL_QUEUE = 4096  # all users together; beyond it only users with an empty queue are admitted
MAX_RETRY_S = 60.0

T = TypeVar("T")


class Pool:
    """Runs expensive functions in threads, within a memory budget. Used on the event loop only."""

    def __init__(
        self, memory: int, threads: int = THREADS, queue_length: int = QUEUE_LENGTH, max_queue_length: int = MAX_QUEUE_LENGTH
    ) -> None:
        """Sets the limits.

        memory: budget in bytes; a function that needs more runs alone. threads: number of functions at a time. queue_length:
        maximum number of waiting requests per user while the expected wait exceeds LONGEST_WAIT_S seconds. max_queue_length:
        maximum while it is shorter.
        """
        self._turns = _FairQueue(threads, memory)
        self._limiter = anyio.CapacityLimiter(threads)
        self._threads = threads
        self._queue_length = threads + queue_length
        self._max_queue_length = threads + max(queue_length, max_queue_length)
        self._made: dict[Hashable, asyncio.Task[Any]] = {}
        self._asked_by: Counter[Hashable] = Counter()
        self._seconds = 0.0  # running average of the latest durations

    @property
    def pending_count(self) -> int:
        """Number of different keys that are queued or being computed."""
        return len(self._made)

    async def run(self, key: Hashable, memory: int, function: Callable[..., T], *arguments: Any, user: Hashable = None) -> T:
        """Runs `function` in a thread when the user's turn comes, and returns its result.

        key: identifies the result; a concurrent request with the same key gets the same result. memory: estimated peak in
        bytes. user: the user in whose queue the request waits. Raises Unavailable if that queue is full.
        """
        task: asyncio.Task[T] | None = self._made.get(key)
        if task is None:
            self._check_queue_length(user)
            self._asked_by[user] += 1
            task = self._made[key] = asyncio.create_task(self._run_in_turn(user, memory, function, *arguments))
            task.add_done_callback(lambda task: self._remove_task(key, user, task))
        return await asyncio.shield(task)  # a client that leaves does not cancel it for others

    def _check_queue_length(self, user: Hashable) -> None:
        """Raises Unavailable if a user's queue is full.

        The limit of the queue is lower while the expected wait exceeds LONGEST_WAIT_S seconds.
        """
        own = self._asked_by.get(user, 0)
        wait_s = own * max(len(self._asked_by), 1) * self._seconds / self._threads
        is_full = own >= (self._queue_length if wait_s > LONGEST_WAIT_S else self._max_queue_length)
        if is_full or (own and self.pending_count >= MAX_TOTAL_QUEUE):
            raise Unavailable(
                Sentence(
                    "picture-requests-too-many",
                    "{count} other pictures that you asked for are not ready yet. Try again in a moment.",
                    count=own,
                ),
                retry_after_s=min(math.ceil(wait_s / 2) + 1, MAX_RETRY_S),
            )

    async def _run_in_turn(self, user: Hashable, memory: int, function: Callable[..., T], *arguments: Any) -> T:
        taken = await self._turns.acquire(user, memory)
        begun = time.monotonic()
        try:
            return await anyio.to_thread.run_sync(function, *arguments, limiter=self._limiter)
        finally:
            self._turns.release(taken)
            self._seconds += (time.monotonic() - begun - self._seconds) / 4
            if self.pending_count == 1:  # the queue is empty after it
                await anyio.to_thread.run_sync(trim_heap, limiter=self._limiter)

    def _remove_task(self, key: Hashable, user: Hashable, task: asyncio.Future[Any]) -> None:
        del self._made[key]
        self._asked_by[user] -= 1
        if not self._asked_by[user]:
            del self._asked_by[user]
        if not task.cancelled():
            task.exception()  # retrieved, so that one without clients is not reported as unhandled


class _FairQueue:
    """Grants threads and memory to waiting requests. Users are served in turn, the requests of one user in order of arrival."""

    def __init__(self, threads: int, memory: int) -> None:
        self._threads = threads
        self._memory = self._all = memory
        self._waiting: OrderedDict[Hashable, deque[tuple[int, asyncio.Future[None]]]] = OrderedDict()  # the next user first

    async def acquire(self, user: Hashable, memory: int) -> int:
        """Waits for a free thread and for `memory` bytes of the budget. Returns the number of bytes to pass to `release`."""
        memory = min(memory, self._all)
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(user, deque()).append((memory, turn))
        self._start_next()
        await turn
        return memory

    def release(self, memory: int) -> None:
        """Frees a thread and `memory` bytes."""
        self._threads += 1
        self._memory += memory
        self._start_next()

    def _start_next(self) -> None:
        while self._waiting and self._threads:
            user, own = next(iter(self._waiting.items()))
            memory, turn = own[0]
            if self._memory < memory:
                return  # a request that needs much memory is not overtaken, else it might never run
            own.popleft()
            self._waiting.move_to_end(user)
            if not own:
                del self._waiting[user]
            if not turn.cancelled():
                self._threads -= 1
                self._memory -= memory
                turn.set_result(None)
