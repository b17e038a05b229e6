"""What a worker reports of itself."""

from __future__ import annotations

import time

import redis

from worker.contract import HEARTBEAT_TTL_S, WorkerReport, render_queue, worker_key
from worker.heartbeat import Reporter


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
