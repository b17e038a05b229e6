"""Tests of the picture pool: limited threads and memory, shared results for equal keys, and bounded queues."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from service.errors import Invalid, Unavailable
from service.watching.pool import Pool


class Work:
    """A task for the picture pool that runs until the test ends it; records its keys and how many run at once."""

    def __init__(self) -> None:
        self.begun: list[object] = []
        self.first = threading.Event()
        self.at_once = self.most = 0
        self.go = threading.Event()
        self._lock = threading.Lock()

    def __call__(self, key: object) -> object:
        with self._lock:
            self.begun.append(key)
            self.first.set()
            self.at_once += 1
            self.most = max(self.most, self.at_once)
        self.go.wait(20)
        with self._lock:
            self.at_once -= 1
        return key


def run(test: Coroutine[Any, Any, None]) -> None:
    """Runs a coroutine in a separate thread, since the main thread may already have a running event loop from browser tests."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, asyncio.wait_for(test, 30)).result()


def test_concurrency_is_limited_and_all_requests_run() -> None:
    async def test() -> None:
        pool, work = Pool(100, threads=2, queue_length=10), Work()
        made = asyncio.gather(*(pool.run(i, 1, work, i) for i in range(9)))
        await asyncio.to_thread(work.first.wait)
        work.go.set()
        assert await made == list(range(9))
        assert work.most <= 2

    run(test())


def test_equal_requests_share_result_despite_cancellation() -> None:
    async def test() -> None:
        pool, work = Pool(100, threads=2, queue_length=10), Work()
        readers = [asyncio.create_task(pool.run("same", 1, work, 7)) for _ in range(20)]
        await asyncio.to_thread(work.first.wait)
        readers[0].cancel()
        await asyncio.sleep(0)
        work.go.set()
        assert await asyncio.gather(*readers[1:]) == [7] * 19
        assert work.begun == [7]
        assert await pool.run("same", 1, work, 8) == 8, "what is asked for later is made anew"

    run(test())


def test_full_queue_rejects_requests() -> None:
    async def test() -> None:
        pool, work = Pool(100, threads=1, queue_length=2, max_queue_length=2), Work()
        made = [asyncio.create_task(pool.run(i, 1, work, i)) for i in range(3)]
        await asyncio.to_thread(work.first.wait)
        with pytest.raises(Unavailable, match="3 other pictures") as refusal:
            await pool.run(3, 1, work, 3)
        assert refusal.value.retry_after_s is not None and 1 <= refusal.value.retry_after_s <= 60
        work.go.set()
        assert await asyncio.gather(*made) == [0, 1, 2]
        assert await pool.run(3, 1, work, 3) == 3

    run(test())


def test_flooding_user_is_rejected_alone() -> None:
    async def test() -> None:
        pool, work = Pool(100, threads=1, queue_length=20, max_queue_length=20), Work()
        flood = [asyncio.create_task(pool.run(i, 1, work, i, user="a")) for i in range(21)]
        await asyncio.to_thread(work.first.wait)
        with pytest.raises(Unavailable, match="21 other pictures that you asked for"):
            await pool.run("too many", 1, work, 99, user="a")
        others = [asyncio.create_task(pool.run((user, i), 1, work, f"{user}{i}", user=user)) for i in range(2) for user in "bc"]
        await asyncio.sleep(0)
        work.go.set()
        await asyncio.gather(*flood, *others)
        assert work.begun[:8] == [0, 1, "b0", "c0", 2, "b1", "c1", 3], "they take turns"
        assert not pool._asked_by

    run(test())


def test_fast_queue_may_be_longer() -> None:
    async def test() -> None:
        pool, work = Pool(100, threads=2, queue_length=4, max_queue_length=400), Work()
        work.go.set()
        assert await asyncio.gather(*(pool.run(i, 1, work, i) for i in range(300))) == list(range(300))
        pool._seconds, hold = 60.0, Work()
        waiting = [asyncio.create_task(pool.run(i, 1, hold, i)) for i in range(6)]
        await asyncio.to_thread(hold.first.wait)
        with pytest.raises(Unavailable) as refusal:
            await pool.run(6, 1, hold, 6)
        assert refusal.value.retry_after_s == 60.0
        hold.go.set()
        await asyncio.gather(*waiting)

    run(test())


def test_memory_budget_is_respected() -> None:
    sizes = [60, 30, 50, 1000, 10, 90, 100, 20, 20, 20]

    async def test() -> None:
        pool, taken, most, alone = Pool(100, threads=8, queue_length=10), 0, 0, True
        lock = threading.Lock()
        together = threading.Semaphore(0)

        def work(size: int) -> int:
            nonlocal taken, most, alone
            with lock:
                taken += size
                most = max(most, taken if size != 1000 else 0)
                alone = alone and (taken == 1000 if size == 1000 else taken < 1000)
            if size == 20:  # these three fit together, so each can wait for the others
                together.release(3)
                assert all(together.acquire(timeout=20) for _ in range(3))
            with lock:
                taken -= size
            return size

        assert await asyncio.gather(*(pool.run(i, size, work, size) for i, size in enumerate(sizes))) == sizes
        assert most <= 100
        assert alone
        assert pool.pending_count == 0

    run(test())


def test_error_is_raised_for_every_waiter() -> None:
    def fail() -> None:
        raise Invalid("This cannot be made.")

    async def test() -> None:
        pool = Pool(100, threads=1, queue_length=2)
        answers = await asyncio.gather(*(pool.run("same", 1, fail) for _ in range(3)), return_exceptions=True)
        assert [type(answer) for answer in answers] == [Invalid] * 3

    run(test())
