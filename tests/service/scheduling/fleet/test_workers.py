"""Tests of pausing workers, and of counting the failures of a worker, which are cleared later."""

from __future__ import annotations

import json
import time
from typing import Any
from urllib.parse import quote

import pytest
import redis

from protocol.contract import HEARTBEAT_TTL_S, worker_key
from protocol.vitals import Vitals, log_key, log_wanted_key, vitals_key
from service.scheduling.faults.suspicion import FORGIVEN_PER_SUCCESS, Suspicion
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest


@pytest.mark.long
def test_paused_worker_takes_no_batches_until_resumed(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=40)
    until(lambda: len(worker.batches) > 3, "the job is under way")
    paused = service.http.patch("/api/workers/peer", json={"state": "paused"})
    assert paused.status_code == 200
    assert (paused.json()["state"], paused.json()["message"]) == ("paused", "Paused by a user.")
    time.sleep(0.5)
    held = len(worker.batches)
    time.sleep(0.5)
    assert len(worker.batches) == held
    assert service.job(job)["message"] == "Waits: all workers are paused."
    service.restart()
    until(lambda: bool(service.http.get("/api/workers").json()), "the service sees the worker again")
    assert service.http.get("/api/workers").json()[0]["state"] == "paused", "it is remembered"
    assert service.http.patch("/api/workers/peer", json={"state": "running"}).json()["message"] is None
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=40)


@pytest.mark.long
def test_worker_with_any_name_can_be_paused(service: Service) -> None:
    for name in ("rack/3", "kühl é 😀", "50%", "a?b#c"):
        with service.worker(name=name):
            until(lambda name=name: [w["name"] for w in service.http.get("/api/workers").json()] == [name], "it is there")
            address = f"/api/workers/{quote(name, safe='')}"
            assert service.http.patch(address, json={"state": "paused"}).json()["state"] == "paused"
            assert service.http.get(f"{address}/log").status_code == 503, "it tells none"


def test_invalid_worker_changes_are_rejected(service: Service, worker: PeerWorker) -> None:
    until(lambda: bool(service.http.get("/api/workers").json()), "the worker is there")
    assert "GET /api/workers" in service.http.patch("/api/workers/nobody", json={"state": "paused"}).json()["detail"]
    assert service.http.patch("/api/workers/nobody", json={"state": "paused"}).status_code == 404
    for change in ({}, {"state": "tired"}, {"state": "paused", "slots": 0}, {"state": None}):
        assert service.http.patch("/api/workers/peer", json=change).status_code == 422


def test_failures_count_only_if_others_succeed_and_are_cleared() -> None:
    suspicion = Suspicion()
    for _ in range(3):
        suspicion.record_success("good", ["bad", "bad"])
    suspicion.record_success("bad", ["bad"])  # the worker's own second attempt
    assert (suspicion.failures_of("bad", ["good"]), suspicion.failures_of("good", ["bad"])) == (2, 0)
    for _ in range(int(3 / FORGIVEN_PER_SUCCESS)):
        suspicion.record_success("bad", [])
    assert suspicion.failures_of("bad", ["good"]) == 0
    suspicion.record_success("good", ["bad"])
    suspicion.clear_failures("bad")
    assert suspicion.failures_of("bad", ["good"]) == 0


def test_successive_failures_count_once_another_succeeds() -> None:
    suspicion = Suspicion()
    suspicion.record_success("good", [])
    for batch in (1, 2, 2, 3):
        suspicion.record_failure("bad", batch)
    assert suspicion.failures_of("bad", ["good"]) == 0, "perhaps it is the job: the other's success was before"
    suspicion.record_success("good", [])
    assert suspicion.failures_of("bad", ["good"]) == 3
    assert suspicion.failures_of("bad", []) == 0
    suspicion.record_success("bad", [])
    assert suspicion.failures_of("bad", ["good"]) == 0


def test_workers_report_memory_and_requested_log(service: Service, worker: PeerWorker) -> None:
    until(lambda: bool(service.http.get("/api/workers").json()), "the worker is there")
    assert service.http.get("/api/workers").json()[0]["memory_total"] is None, "one of an older release"
    assert service.http.get("/api/workers/peer/log").status_code == 503
    assert service.http.get("/api/workers/nobody/log").status_code == 404
    worker.redis.set(vitals_key("peer"), Vitals(3, 8).to_bytes(), ex=60)
    worker.redis.set(log_key("peer"), json.dumps(["one", "two"]), ex=60)
    until(lambda: service.http.get("/api/workers").json()[0]["memory_total"] == 8, "its memory is told")
    told = service.http.get("/api/workers").json()[0]
    assert (told["memory_used"], told["failures"]) == (3, 0) and len(told["speeds"]) == 1
    assert service.http.get("/api/workers/peer/log").json() == ["one", "two"]
    assert worker.redis.exists(log_wanted_key("peer"))


def test_departed_worker_is_removed_despite_redis_clock_set_back(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that a departed worker is removed even if the clock of Redis is set back.

    Otherwise its report would expire late. Until then its batches would count as held, and its slots as available.
    """
    fleet, hour = service.farm.engine._workers, 3600
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        with service.worker(name="gone"):
            until(lambda: "gone" in fleet.roster.reports, "it is there")
            report: Any = store.get(worker_key("gone"))
        store.set(worker_key("gone"), report, ex=hour)  # expiry of the worker's last report by that clock
        until(lambda: "gone" in fleet.roster.reports, "it seems to be there")
        seconds, micros = store.time()  # type: ignore[misc]
        monkeypatch.setattr(fleet._redis, "time", lambda: (seconds - hour, micros))
        until(lambda: store.ttl(worker_key("gone")) <= HEARTBEAT_TTL_S, "it expires as it was meant to")  # type: ignore[operator]
