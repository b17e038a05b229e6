"""Few pictures at a time, one for all who ask for the same, and no line without an end."""

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
    """What takes as long as the test wants."""

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
    """On a thread of its own: where browser tests share the process, its first thread has a loop already."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, asyncio.wait_for(test, 30)).result()


def test_few_run_at_a_time_and_all_come_to_their_turn() -> None:
    async def test() -> None:
        pool, work = Pool(threads=2, in_line=10), Work()
        made = asyncio.gather(*(pool.make(i, work, i) for i in range(9)))
        await asyncio.to_thread(work.first.wait)
        work.go.set()
        assert await made == list(range(9))
        assert work.most <= 2

    run(test())


def test_those_who_ask_for_the_same_share_one_answer_also_when_the_first_leaves() -> None:
    async def test() -> None:
        pool, work = Pool(threads=2, in_line=10), Work()
        readers = [asyncio.create_task(pool.make("same", work, 7)) for _ in range(20)]
        await asyncio.to_thread(work.first.wait)
        readers[0].cancel()
        await asyncio.sleep(0)
        work.go.set()
        assert await asyncio.gather(*readers[1:]) == [7] * 19
        assert work.begun == [7]
        assert await pool.make("same", work, 8) == 8, "what is asked for later is made anew"

    run(test())


def test_a_line_that_is_too_long_turns_readers_away_until_it_is_shorter() -> None:
    async def test() -> None:
        pool, work = Pool(threads=1, in_line=2), Work()
        made = [asyncio.create_task(pool.make(i, work, i)) for i in range(3)]
        await asyncio.to_thread(work.first.wait)
        with pytest.raises(Unavailable, match="3 other pictures"):
            await pool.make(3, work, 3)
        work.go.set()
        assert await asyncio.gather(*made) == [0, 1, 2]
        assert await pool.make(3, work, 3) == 3

    run(test())


def test_what_goes_wrong_is_told_to_every_reader() -> None:
    def fail() -> None:
        raise Invalid("This cannot be made.")

    async def test() -> None:
        pool = Pool(threads=1, in_line=2)
        answers = await asyncio.gather(*(pool.make("same", fail) for _ in range(3)), return_exceptions=True)
        assert [type(answer) for answer in answers] == [Invalid] * 3

    run(test())
