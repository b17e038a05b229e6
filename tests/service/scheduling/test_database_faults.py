"""Tests of a locked, read-only or unreachable database. Films continue, and pending writes are made once it is available."""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import pytest
from sqlalchemy import event

from protocol.contract import RESULTS
from service.errors import Unavailable
from service.scheduling.records import Records
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest
from tests.service.scheduling.test_faults import film_of, lock_database, rendered_once, slow, start_job


@pytest.mark.long
def test_locked_database_does_not_stop_running_jobs(service: Service, worker: PeerWorker) -> None:
    if service.options["database_url"]:
        return  # PostgreSQL has no lock of the whole database
    worker.on_batch = slow
    job = start_job(service, worker, spp=60)
    with lock_database(service.options["data"] / "rayfarm.sqlite"):
        assert service.job(job)["samples"] < 64 * 48 * 60
        until(lambda: service.http.get("/readyz").status_code == 503, "the service says so", 10)
        assert "database" in service.http.get("/readyz").json()["detail"]
        until(lambda: service.job(job)["samples"] == 64 * 48 * 60, "the films go on, up to the last sample")
        assert service.job(job)["state"] == "running", "the database cannot say otherwise"
    service.wait_for(job, "finished")
    until(lambda: service.http.get("/readyz").status_code == 200, "the service is ready again")
    assert service.digest(job) == expected_digest(spp=60)
    assert rendered_once(worker, job)


@pytest.mark.long
def test_read_only_database(service: Service, worker: PeerWorker) -> None:
    if service.options["database_url"]:
        return
    worker.on_batch = slow
    job = start_job(service, worker, spp=60)
    is_read_only = threading.Event()

    def obey(connection: Any, *_: Any) -> None:
        connection.execute(f"PRAGMA query_only={'ON' if is_read_only.is_set() else 'OFF'}")

    event.listen(service.farm.database, "checkout", obey)
    is_read_only.set()
    until(lambda: service.http.get("/readyz").status_code == 503, "the service says so")
    assert "read-only" in service.http.get("/readyz").json()["detail"]
    until(lambda: service.job(job)["samples"] == 64 * 48 * 60, "the films go on")
    is_read_only.clear()
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=60)


def failing_while(flag: threading.Event, method: Any) -> Any:
    """Returns a method of Records that fails while `flag` is set, as if the database were unreachable."""

    def instead(*arguments: Any) -> Any:
        if flag.is_set():
            raise Unavailable("The database does not answer.")
        return method(*arguments)

    return instead


def test_unreachable_database_at_start_gives_error(
    service: Service, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    service.stop()
    away = threading.Event()
    away.set()
    monkeypatch.setattr(Records, "all_jobs", failing_while(away, Records.all_jobs))
    service.start()
    until(lambda: "does not answer" in service.http.get("/readyz").text, "the service says so")
    assert service.http.get("/readyz").json()["detail"] == "The database does not answer."
    assert [record.getMessage() for record in caplog.records].count("The database does not answer.") == 1
    away.clear()
    until(lambda: service.http.get("/readyz").status_code == 200, "the service is ready")


@pytest.mark.long
def test_end_of_preparation_is_stored_after_database_fault(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = threading.Event()
    away.set()
    monkeypatch.setattr(Records, "prepare_failed", failing_while(away, Records.prepare_failed))
    scene = service.upload(b"broken")
    until(lambda: bool(worker.prepared), "a worker has looked at the scene")
    time.sleep(5.5)  # longer than until a batch counts as lost
    assert len(worker.prepared) == 1, "the worker has done it once"
    away.clear()
    until(lambda: service.scene(scene)["status"] == "failed", "it is written down")
    assert "this is no scene" in service.scene(scene)["error"]


def test_job_deleted_before_end_is_stored_leaves_no_film(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker.on_batch = slow
    job = start_job(service, worker)
    away = threading.Event()
    away.set()
    monkeypatch.setattr(Records, "mark_failed", failing_while(away, Records.mark_failed))
    service.farm.engine._bulkheads.give_verdict(job, "The film of this job is lost.")
    service.http.delete(f"/api/jobs/{job}").raise_for_status()
    time.sleep(0.5)  # the engine notices it meanwhile
    away.clear()
    until(lambda: not film_of(service, job).exists(), "its film is gone")


def answers_of(worker: PeerWorker, job: str) -> bool:
    """Returns True if the result stream contains a result for this job."""
    return any(json.loads(fields[b"event"]).get("job") == job for _, fields in worker.redis.xrange(RESULTS))


@pytest.mark.long
def test_results_of_unloaded_job_are_kept(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    worker.on_batch = slow
    job = start_job(service, worker)
    service.stop()
    until(lambda: answers_of(worker, job), "the worker answers meanwhile")
    away = threading.Event()
    away.set()
    monkeypatch.setattr(Records, "pending", failing_while(away, Records.pending))
    service.start()
    until(lambda: "does not answer" in (service.job(job)["message"] or ""), "the job says what it waits for")
    time.sleep(1.0)
    assert answers_of(worker, job)
    away.clear()
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)
    until(lambda: not answers_of(worker, job), "the stream is trimmed")


def test_nul_character_is_no_database_fault(service: Service) -> None:
    """Checks that NUL characters, which PostgreSQL does not accept, are not treated as a fault of the database."""
    assert service.http.get("/api/jobs/%00").status_code == 404
    assert service.http.get("/%00").status_code == 404
    asked = {"scene": "\0", "width": 16, "height": 16}
    assert service.http.post("/api/jobs", json=asked).status_code in (404, 422)
    assert service.http.post("/api/jobs", json={**asked, "scene": service.upload(), "after": ["a\0"]}).status_code in (404, 422)
