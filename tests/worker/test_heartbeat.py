"""Tests of a worker's periodic reports (heartbeat)."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
import redis

from protocol.contract import HEARTBEAT_TTL_S, WorkerReport, pause_key, render_queue, worker_key
from protocol.joint import help_queue
from protocol.terms import Offer, offer_key, terms_key
from protocol.vitals import log_wanted_key
from tests.slow_line import held_up
from worker.exchange.heartbeat_message import HeartbeatConnection, HeartbeatReply
from worker.heartbeat import Heartbeat, Reporter
from worker.process import context


def report(name: str, pid: int, host: str = "here") -> WorkerReport:
    return WorkerReport(name, host, pid, 2, "cpu", "kind", "starting", time.time())


def test_report_expires_and_can_be_deleted(redis_url: str, store: redis.Redis) -> None:
    reporter = Reporter(redis_url)
    mine = report("a", 1)
    assert reporter.write_report(mine)
    assert WorkerReport.from_bytes(store.get(worker_key("a"))) == mine  # type: ignore[arg-type]
    assert 0 < store.ttl(worker_key("a")) <= HEARTBEAT_TTL_S
    reporter.delete_report("a")
    assert store.get(worker_key("a")) is None


def test_unreachable_redis_is_tolerated() -> None:
    reporter = Reporter("redis://127.0.0.1:9/0")
    assert not reporter.write_report(report("a", 1))
    reporter.delete_report("a")


def test_heartbeat_is_one_pipeline(redis_url: str, store: redis.Redis) -> None:
    telling, mine = HeartbeatConnection(redis_url), report("a", 1)
    assert telling.receive() is None
    store.rpush(render_queue("kind"), b"1", b"2")
    telling.send(mine, Offer(("gpu",), 8 << 30, 2, ""), [("SET", "also", "said")])
    assert telling.receive(5.0) == HeartbeatReply(True, is_help_queued=False, waiting=2)
    assert WorkerReport.from_bytes(store.get(worker_key("a"))) == mine  # type: ignore[arg-type]
    assert 0 < store.ttl(worker_key("a")) <= HEARTBEAT_TTL_S
    assert Offer.from_bytes(store.get(offer_key("a"))).tags == ("gpu",)  # type: ignore[arg-type]
    assert store.get("also") == b"said"
    for key, value in ((pause_key("a"), b"why"), (terms_key("a"), b"{}"), (log_wanted_key("a"), b"1")):
        store.set(key, value)
    store.rpush(help_queue("a"), b"1")
    for _ in range(3):
        telling.send(mine, None, [])
    heard = None
    while telling._sent:
        heard = telling.receive(5.0) or heard
    assert heard == HeartbeatReply(True, is_paused=True, terms=b"{}", is_log_wanted=True, waiting=2), (
        "the latest of those that came"
    )
    store.delete(pause_key("a"), terms_key("a"), log_wanted_key("a"), help_queue("a"), render_queue("kind"))
    telling.close()


def test_report_does_not_wait_for_late_replies(redis_url: str, store: redis.Redis) -> None:
    """Checks that sending reports does not wait for replies of Redis, each of which is 0.4 s late."""
    with held_up(redis_url, 0.4) as url:
        telling, mine = HeartbeatConnection(url), report("slow", 1)
        telling.send(mine, None, [])
        begun, heard = time.monotonic(), 0
        for _ in range(20):
            telling.send(mine, None, [])
            heard += telling.receive(0.01) is not None
            time.sleep(0.05)
        assert time.monotonic() - begun < 4, "20 late replies take 8 s"
        assert heard > 0
        assert store.exists(worker_key("slow"))
        telling.close()


def test_no_reply_without_redis() -> None:
    telling = HeartbeatConnection("redis://127.0.0.1:9/0")
    telling.send(report("a", 1), None, [])
    assert telling.receive(0.1) is None
    telling.close()


def test_redis_errors_are_retried_and_logged_once(
    redis_url: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
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
        heartbeat._apply_pause()
        assert heartbeat.is_paused, "it does not say that it takes tasks while it takes none"
    heartbeat._apply_pause()
    assert not heartbeat.is_paused
    assert taken == ["render", "prepare"]
    assert sum("cannot be taken now: maxmemory" in line for line in caplog.messages) == 1
    heartbeat.latest = HeartbeatReply(True, is_paused=True)
    heartbeat._apply_pause()
    assert heartbeat.is_paused
    assert taken == []
