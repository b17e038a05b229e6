"""Tests of a faulty Redis, one kind of fault per test. The service reports the fault, loses nothing, and recovers afterwards."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import redis

from protocol.contract import RESULTS
from service.scheduling import engine
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest


def full(store: redis.Redis, is_so: bool) -> None:
    store.config_set("maxmemory", "1" if is_so else "0")


def read_only(store: redis.Redis, is_so: bool) -> None:
    store.replicaof(*(("127.0.0.1", 9) if is_so else ("NO", "ONE")))


@pytest.mark.long  # tests below check that the fault is reported and that every call is repeated
@pytest.mark.parametrize("spoil", [read_only, full])
def test_rejecting_redis_only_delays_jobs(
    service: Service, worker: PeerWorker, spoil: Callable[[redis.Redis, bool], None]
) -> None:
    worker.on_batch = lambda batch: time.sleep(0.1)  # long enough that the job is still running when Redis is damaged
    job = service.submit(service.ready_scene(), spp=30)
    until(lambda: service.job(job)["progress"] > 0, "the job is under way")
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        spoil(store, True)
        try:
            until(lambda: service.http.get("/readyz").status_code == 503, "the service says so")
            assert "Redis" in service.http.get("/readyz").json()["detail"]
            assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 200
        finally:
            spoil(store, False)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)
    until(lambda: service.http.get("/readyz").status_code == 200, "it is ready again")


@pytest.mark.long
@pytest.mark.parametrize(("spoil", "said"), [(full, "Redis is full"), (read_only, "Redis accepts no writes: it is a replica")])
def test_rejecting_redis_is_detected_when_idle(service: Service, spoil: Callable[[redis.Redis, bool], None], said: str) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        spoil(store, True)
        try:
            until(lambda: said in service.http.get("/readyz").text, "the service says so")
        finally:
            spoil(store, False)
    until(lambda: service.http.get("/readyz").status_code == 200, "it is ready again")


def test_every_redis_call_is_retried(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: Counter[str] = Counter()
    monkeypatch.setattr(engine, "PAUSE_AFTER_FAULT_S", 0.05)
    execute = redis.Redis.execute_command

    def instead(self: redis.Redis, *arguments: Any, **options: Any) -> Any:
        if threading.current_thread() is service.farm.engine._thread:
            calls[str(arguments[0])] += 1
            if calls[str(arguments[0])] in (1, 3):
                raise redis.ConnectionError("the connection was closed")
        return execute(self, *arguments, **options)

    monkeypatch.setattr(redis.Redis, "execute_command", instead)
    with service.worker() as worker:
        job = service.submit(service.ready_scene(), tile_size=32)
        service.wait_for(job, "finished")
        assert service.digest(job) == expected_digest()
        until(lambda: worker.redis.xlen(RESULTS) == 0, "the stream is trimmed")
    assert {"XREAD", "XDEL", "SCAN", "MGET", "LPUSH"} <= set(calls)
