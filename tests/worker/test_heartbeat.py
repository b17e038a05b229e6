"""What a worker reports of itself."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
import redis

from worker.heartbeat import Heartbeat, Reporter
from worker.process import context
from worker.protocol.contract import HEARTBEAT_TTL_S, WorkerReport, order_key, render_queue, worker_key


def report(name: str, pid: int, host: str = "here") -> WorkerReport:
    return WorkerReport(name, host, pid, 2, "cpu", "kind", "starting", time.time())


def test_a_report_expires_and_can_be_taken_away(redis_url: str, store: redis.Redis) -> None:
    reporter = Reporter(redis_url)
    mine = report("a", 1)
    assert reporter.beat(mine)
    assert WorkerReport.from_bytes(store.get(worker_key("a"))) == mine  # type: ignore[arg-type]
    assert 0 < store.ttl(worker_key("a")) <= HEARTBEAT_TTL_S
    reporter.leave("a")
    assert store.get(worker_key("a")) is None


def test_a_worker_outlives_a_redis_that_is_away() -> None:
    reporter = Reporter("redis://127.0.0.1:9/0")
    assert not reporter.beat(report("a", 1))
    reporter.leave("a")
    assert reporter.waiting("kind") == 0


def test_what_waits_is_counted(redis_url: str, store: redis.Redis) -> None:
    store.rpush(render_queue("kind"), b"1", b"2")
    assert Reporter(redis_url).waiting("kind") == 2


def test_what_redis_refuses_is_tried_again_at_the_next_beat_and_said_once(
    redis_url: str, store: redis.Redis, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    refusals = [redis.OutOfMemoryError("maxmemory"), redis.OutOfMemoryError("maxmemory")]
    taken: list[str] = []

    def add(queue: str) -> None:
        if refusals:
            raise refusals.pop()
        taken.append(queue)

    consumer = SimpleNamespace(add_task_queue=add, cancel_task_queue=taken.remove)
    worker = SimpleNamespace(redis_url=redis_url, name="w", kind="k", queues=["render", "prepare"], keeping=None)
    monkeypatch.setattr(context, "_current", worker)
    heartbeat = Heartbeat(consumer)
    heartbeat.is_paused = True
    for _ in range(2):
        heartbeat._obey()
        assert heartbeat.is_paused, "it does not say that it takes tasks while it takes none"
    heartbeat._obey()
    assert not heartbeat.is_paused
    assert taken == ["render", "prepare"]
    assert sum("cannot be taken now: maxmemory" in line for line in caplog.messages) == 1
    store.set(order_key("w"), "Paused by a test.")
    heartbeat._obey()
    assert heartbeat.is_paused
    assert taken == []
