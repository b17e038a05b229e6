"""Tests that a stopping worker reports its current work until it has ended."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import redis

from protocol.contract import WorkerReport, worker_key
from tests.helpers import wait_until
from worker.shutdown_reporter import ShutdownReporter


def test_stopping_worker_reports_until_its_end(redis_url: str, store: redis.Redis) -> None:
    def report(is_paused: bool) -> WorkerReport:
        return WorkerReport("attic", "host", 1, 1, "cpu", "kind", "paused" if is_paused else "ready", 0.0, 0.0, [{"batch": "b"}])

    worker: Any = SimpleNamespace(name="attic", redis_url=redis_url, report=report)
    leaving = ShutdownReporter(worker)
    leaving.begin(how="Warm")
    leaving.begin(how="Warm")

    def said() -> WorkerReport | None:
        data = store.get(worker_key("attic"))
        return WorkerReport.from_bytes(data) if isinstance(data, bytes) else None

    wait_until(lambda: said() is not None, 20, "it reports itself")
    first = said()
    assert first is not None
    assert (first.state, first.current) == ("paused", [{"batch": "b"}])
    store.delete(worker_key("attic"))
    wait_until(lambda: said() is not None, 20, "and again")
    leaving.stop()
    assert said() is None
