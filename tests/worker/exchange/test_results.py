"""Tests of sending results to the service: the backlog is bounded, and sending continues after a restart of Redis."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import redis

from protocol.contract import RESULTS, Result
from tests.helpers import running_redis
from tests.slow_line import held_up
from worker.exchange import results
from worker.exchange.results import ResultStream


def test_result_arrives_unchanged(redis_url: str) -> None:
    with redis.Redis.from_url(redis_url) as store:
        store.delete(RESULTS)
        assert ResultStream(redis_url).send(Result({"type": "batch", "batch": "b1"}, b"\x00\xff"))
        [(_, fields)] = store.xrange(RESULTS)
        assert Result.from_fields(fields) == Result({"type": "batch", "batch": "b1"}, b"\x00\xff")
        store.delete(RESULTS)


def test_full_stream_is_retried_until_timeout(redis_url: str) -> None:
    with redis.Redis.from_url(redis_url) as store:
        store.delete(RESULTS)
        stream = ResultStream(redis_url, max_entries=2, timeout_s=0.3)
        assert stream.send(Result({"type": "a"}))
        assert stream.send(Result({"type": "b"}))
        assert not stream.send(Result({"type": "c"}))
        assert store.xlen(RESULTS) == 2
        store.delete(RESULTS)
        assert stream.send(Result({"type": "c"}))
        store.delete(RESULTS)


def test_sending_a_large_result_may_exceed_the_timeout(
    redis_url: str, store: redis.Redis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Checks that a large result arrives over a slow connection although sending it takes longer than the timeout."""
    monkeypatch.setattr(results, "PIECE_TIMEOUT_S", 0.3)
    store.delete(RESULTS)
    with held_up(redis_url, rate=400e3) as url:
        sums, begun = np.random.default_rng(1).bytes(400_000), time.monotonic()
        assert ResultStream(url, timeout_s=0.1).send(Result({"type": "a"}, sums))
        assert time.monotonic() - begun > 3 * results.PIECE_TIMEOUT_S
    [(_, fields)] = store.xrange(RESULTS)  # type: ignore[misc]
    assert Result.from_fields(fields).sums == sums  # type: ignore[arg-type]
    store.delete(RESULTS)


def test_result_is_sent_after_redis_restart(tmp_path: Path) -> None:
    server = running_redis(tmp_path)
    server.start()
    try:
        stream = ResultStream(server.url)
        assert stream.send(Result({"type": "before"}))
        server.stop()
        with ThreadPoolExecutor() as pool:
            sending = pool.submit(stream.send, Result({"type": "after"}))
            time.sleep(0.5)
            assert not sending.done()
            server.start()  # in this thread, since a server ends with the thread that started it
            assert sending.result(10)
        with redis.Redis.from_url(server.url) as store:
            assert store.xlen(RESULTS) == 1
    finally:
        server.stop()


@pytest.mark.parametrize("trouble", ["full", "read-only", "of another type"])
def test_redis_errors_are_retried_and_logged_once(tmp_path: Path, trouble: str, caplog: pytest.LogCaptureFixture) -> None:
    server = running_redis(tmp_path)
    server.start()
    try:
        with redis.Redis.from_url(server.url) as store, ThreadPoolExecutor() as pool:
            if trouble == "full":
                store.config_set("maxmemory", "1")
            elif trouble == "read-only":
                store.replicaof("127.0.0.1", "1")
            else:
                store.set(RESULTS, "a text")
            sending = pool.submit(ResultStream(server.url).send, Result({"type": "a"}))
            time.sleep(1.0)
            assert not sending.done()
            store.config_set("maxmemory", "0")
            store.replicaof("NO", "ONE")
            if trouble == "of another type":
                store.delete(RESULTS)
            assert sending.result(10)
            assert store.xlen(RESULTS) == 1
    finally:
        server.stop()
    assert sum("a result waits" in line for line in caplog.messages) == 1


def test_droppable_events_are_not_retried() -> None:
    begun = time.monotonic()
    assert not ResultStream("redis://127.0.0.1:9/0").send(Result({"type": "prepare-progress"}), timeout_s=0.0)
    assert time.monotonic() - begun < 60
