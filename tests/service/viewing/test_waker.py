"""Tests that waking the scheduler of live views does not wait for Redis, even if Redis hangs."""

from __future__ import annotations

import threading
import time
from unittest.mock import MagicMock

import redis

from protocol.view_parts import VIEW_ANSWERS
from service.viewing.waker import Waker
from tests.helpers import wait_until


def test_wake_does_not_block_on_hanging_redis() -> None:
    hangs, answers = threading.Event(), threading.Event()
    connection = MagicMock()
    at_once = connection.pipeline.return_value.__enter__.return_value

    def execute() -> None:
        hangs.set()
        assert answers.wait(20)
        raise redis.TimeoutError("it hung")

    at_once.execute.side_effect = execute
    waker = Waker(connection)
    waker.start()
    waker.wake()
    assert hangs.wait(20)
    begun = time.thread_time()
    for _ in range(1000):
        waker.wake()
    assert not answers.is_set()
    assert time.thread_time() - begun < 1
    at_once.execute.side_effect = None
    answers.set()
    wait_until(lambda: at_once.execute.call_count == 2, 20, "it is rung once more, and for all of them together")
    at_once.rpush.assert_called_with(VIEW_ANSWERS, b"")
    waker.stop()
    assert not waker._thread.is_alive()
