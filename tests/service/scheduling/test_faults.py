"""Tests of faults of films and jobs, one fault per test: unrelated jobs continue, and nothing is lost."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from protocol.contract import RenderBatch
from service.errors import FilmUnavailable
from service.scheduling.faults import bulkhead
from service.scheduling.records import PendingJob, Records
from service.store.database import connect
from service.store.disk_space import disk_full_error
from service.store.film_file import FilmFile
from service.store.films import Film
from service.store.models import Job
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest


def film_of(service: Service, job: str) -> Path:
    path: Path = service.options["data"] / "films" / f"{job}.sqlite"
    return path


@contextmanager
def lock_database(path: Path) -> Iterator[None]:
    """Holds a write lock on a database file from another connection during the `with` block."""
    other = sqlite3.connect(path, timeout=10, isolation_level=None)
    try:
        other.execute("BEGIN IMMEDIATE")
        yield
    finally:
        other.close()


def start_job(service: Service, worker: PeerWorker, **request: Any) -> str:
    """Submits a job. Returns its id when it has some samples and is still being rendered."""
    job = service.submit(service.ready_scene(), **{"spp": 30, **request})
    until(lambda: service.job(job)["samples"] > 0, "the job is under way")
    return job


def slow(batch: RenderBatch) -> None:
    time.sleep(0.02)


def rendered_once(worker: PeerWorker, job: str) -> bool:
    return len({(b.tile, b.first) for b in worker.batches if b.job == job}) == sum(b.job == job for b in worker.batches)


@pytest.mark.long
def test_locked_film_waits_and_other_jobs_continue(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    held = start_job(service, worker)
    with lock_database(film_of(service, held)):
        other = service.submit(service.ready_scene(), spp=30, seed=1)
        until(lambda: "is locked" in (service.job(held)["message"] or ""), "the job says what it waits for")
        service.wait_for(other, "finished")
        assert service.job(held)["state"] == "running"
        until(lambda: service.http.get("/readyz").status_code == 503, "of all unfinished jobs none goes on")
        assert "is locked" in service.http.get("/readyz").json()["detail"]
        time.sleep(2.5)  # longer than until a batch counts as lost
    service.wait_for(held, "finished")
    assert service.http.get("/readyz").status_code == 200
    assert (service.digest(held), service.digest(other)) == (expected_digest(spp=30), expected_digest(spp=30, seed=1))
    assert rendered_once(worker, held)
    counts = service.farm.engine.snapshot.counts
    assert (counts.get("dropped", 0), counts["lost"]) == (0, 0)


@pytest.mark.long
def test_film_on_full_disk_waits_for_space(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    full = start_job(service, worker)
    file = film_file(service, full)
    file._database.execute(f"PRAGMA max_page_count={file._database.execute('PRAGMA page_count').fetchone()[0]}")
    other = service.submit(service.ready_scene(), spp=30, seed=1)
    until(lambda: "the disk is full" in (service.job(full)["message"] or ""), "the job says what it waits for")
    service.wait_for(other, "finished")
    file._database.execute("PRAGMA max_page_count=1000000")
    service.wait_for(full, "finished")
    assert service.digest(full) == expected_digest(spp=30)
    assert rendered_once(worker, full)
    assert service.farm.engine.snapshot.counts.get("dropped", 0) == 0


@pytest.mark.long
def test_film_unreadable_at_start_waits(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    job = start_job(service, worker)
    service.stop()
    with lock_database(film_of(service, job)):
        service.start()
        until(lambda: "is locked" in (service.job(job)["message"] or ""), "the job says what it waits for")
        service.wait_for(service.submit(service.ready_scene(), spp=4, seed=1), "finished")
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)


def film_file(service: Service, job: str) -> FilmFile:
    film = service.farm.engine._scheduler.jobs[job].film
    assert film._file is not None
    return film._file


def garbage(service: Service, job: str) -> None:
    service.stop()
    film_of(service, job).write_bytes(b"this is no film" * 4000)
    service.start()


def no_table(service: Service, job: str) -> None:
    with closing(sqlite3.connect(film_of(service, job), timeout=10)) as other, other:
        other.execute("DROP TABLE part")
    other.close()


@pytest.mark.long  # tests/service/store/test_lost_films.py tests damage that is repaired automatically
@pytest.mark.parametrize("spoil", [garbage, no_table])
def test_lost_film_is_rendered_again_automatically(
    service: Service, worker: PeerWorker, spoil: Callable[[Service, str], None]
) -> None:
    worker.on_batch = slow
    lost = start_job(service, worker, spp=120)
    until(lambda: service.farm.records.samples(lost, 0) > 0, "it is written down that the film has some")
    spoil(service, lost)
    service.wait_for(lost, "finished", 60)
    assert "healed" in [event["kind"] for event in service.http.get(f"/api/jobs/{lost}/history").json()["events"]]
    assert service.digest(lost) == expected_digest(spp=120)


@pytest.mark.long
def test_lost_film_fails_its_job_until_restarted(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    lost = start_job(service, worker)
    other = service.submit(service.ready_scene(), spp=30, seed=1)
    service.options["film_check_days"] = 0  # disables automatic repair
    garbage(service, lost)
    failed = service.wait_for(lost, "failed")
    assert "film" in failed["error"]
    assert ". Set the job to running to render it again." in failed["error"]
    service.wait_for(other, "finished")
    assert service.patch(lost, state="running")["state"] == "queued"
    assert service.wait_for(lost, "finished")["error"] is None
    assert service.digest(lost) == expected_digest(spp=30)


@pytest.mark.long
def test_unwritable_film_waits_and_keeps_samples(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    job = start_job(service, worker)
    other = service.submit(service.ready_scene(), spp=30, seed=1)
    database = film_file(service, job)._database
    database.execute("PRAGMA query_only=ON")
    until(lambda: "is read-only" in (service.job(job)["message"] or ""), "the job says what it waits for")
    service.wait_for(other, "finished")
    assert service.job(job)["state"] == "running"
    database.execute("PRAGMA query_only=OFF")
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)
    assert rendered_once(worker, job)


@pytest.mark.long
@pytest.mark.parametrize("spoil", [*(pytest.param(spoil, marks=pytest.mark.long) for spoil in ("missing", "empty")), "damaged"])
def test_lost_finished_picture_is_rendered_again_on_request(service: Service, worker: PeerWorker, spoil: str) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    service.stop()
    path = film_of(service, job)
    if spoil == "missing":
        path.unlink()
    else:
        path.write_bytes(b"" if spoil == "empty" else path.read_bytes()[:-40000] + b"\xee" * 40000)
    service.options["film_check_days"] = 0  # disables automatic repair
    service.start()
    broken = service.http.get(f"/api/jobs/{job}/frames/0/digest")
    assert broken.status_code == 409
    assert "the job to running" in broken.json()["detail"]
    service.patch(job, state="running")
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()
    service.patch(job, state="running")
    assert service.wait_for(job, "finished")["samples"] == 64 * 48 * 8, "where nothing is missing, nothing is rendered"


def failing_at_first(method: Any, error: Callable[[], Exception], applies: Callable[..., bool], failed: Counter[str]) -> Any:
    """Returns a replacement for `method` that raises `error()` in the first and third call for which `applies` returns True.

    failed: counts the raised errors by the name of the method.
    """
    calls = Counter[str]()

    def instead(self: Any, *arguments: Any, **named: Any) -> Any:
        if applies(self, *arguments):
            calls[method.__name__] += 1
            if calls[method.__name__] in (1, 3):
                failed[method.__name__] += 1
                raise error()
        return method(self, *arguments, **named)

    return instead


RECORDS = (
    "pending",
    "scene",
    "resolve",
    "mark_started",
    "store_progress",
    "mark_finished",
    "prepared",
    "jobs_of",
    "all_jobs",
    "active_jobs",
)


def test_every_database_call_is_retried(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    service.stop()
    monkeypatch.setattr(bulkhead, "RETRY_S", 0.1)
    failed: Counter[str] = Counter()
    for name in RECORDS:
        monkeypatch.setattr(Records, name, failing_at_first(getattr(Records, name), disk_full_error, lambda *_: True, failed))
    service.start()
    with service.worker() as worker:
        scene = service.upload()
        jobs = [service.submit(scene, seed=seed) for seed in range(2)]
        for seed, job in enumerate(jobs):
            assert service.wait_for(job, "finished", 60)["error"] is None
            assert service.digest(job) == expected_digest(seed=seed)
            assert rendered_once(worker, job)
    assert set(failed) == set(RECORDS)


FILM = ("open_file", "coverage", "bad_samples", "merge", "tile_planes", "tile_index")


@pytest.mark.long
def test_every_film_call_is_retried(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bulkhead, "RETRY_S", 0.1)
    failed: Counter[str] = Counter()
    engine = service.farm.engine._thread

    scene = service.ready_scene()
    other = service.submit(scene, spp=256, noise=0.09, seed=1)

    def is_meant(film: Film, *_: Any) -> bool:
        return threading.current_thread() is engine and film._path.stem != other

    for name in FILM:
        wait = lambda: FilmUnavailable("The film of this job cannot be written: the disk is full.")  # noqa: E731
        monkeypatch.setattr(Film, name, failing_at_first(getattr(Film, name), wait, is_meant, failed))
    job = service.submit(scene, spp=256, noise=0.09, seed=1)
    assert service.wait_for(job, "finished", 60)["error"] is None
    service.wait_for(other, "finished", 60)
    assert service.digest(job) == service.digest(other)
    assert set(failed) == set(FILM)
    assert failed["merge"] == failed["tile_planes"] == 2


@pytest.mark.long
def test_bug_in_one_job_fails_only_that_job(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    worker.on_batch = slow
    one = start_job(service, worker)
    other = service.submit(service.ready_scene(), spp=30, seed=1)
    plan = service.farm.engine._scheduler.jobs[one].frames[0].plan
    monkeypatch.setattr(plan, "next_batch", lambda *_: [][0])
    failed = service.wait_for(one, "failed")
    assert "IndexError" in failed["error"]
    service.wait_for(other, "finished")
    assert service.http.get("/readyz").status_code == 200
    service.patch(one, state="running")
    service.wait_for(one, "finished")
    assert service.digest(one) == expected_digest(spp=30)


@pytest.mark.long
def test_job_deleted_during_loading_delays_no_other(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Checks that a job that is deleted while it is being loaded delays no other job.

    It is deleted after its rows were read.
    """
    scene, records, deleted = service.ready_scene(), service.farm.records, list[str]()
    pending = records.pending

    def read(jobs: list[str]) -> dict[str, PendingJob]:
        found = pending(jobs)
        if not deleted:
            deleted.append(jobs[0])
            service.http.delete(f"/api/jobs/{jobs[0]}").raise_for_status()
        return found

    monkeypatch.setattr(records, "pending", read)
    gone, other = service.submit(scene), service.submit(scene, seed=1)
    service.wait_for(other, "finished")
    assert deleted == [gone]
    assert service.http.get(f"/api/jobs/{gone}").status_code == 404
    assert not [line for line in caplog.messages if "fault" in line or "cannot continue" in line]


@pytest.mark.long
@pytest.mark.parametrize("camera", ["²", "7" * 1000], ids=["superscript", "1000 digits"])
def test_invalid_camera_is_rejected_or_fails_its_job(service: Service, worker: PeerWorker, camera: str) -> None:
    go = threading.Event()
    worker.on_prepare = lambda scene: (go.wait(10), None)[1]
    scene = service.upload()
    early, other = service.submit(scene, camera=camera), service.submit(scene)
    go.set()
    assert "camera is" in service.wait_for(early, "failed")["error"]
    service.wait_for(other, "finished")
    refused = service.http.post("/api/jobs", json={"scene": scene, "camera": camera})
    assert refused.status_code == 422
    assert "camera" in refused.json()["detail"]


@pytest.mark.long
def test_settings_of_newer_release_fail_only_their_job(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = slow
    newer, other = start_job(service, worker), start_job(service, worker, seed=1)
    service.stop()
    engine, sessions = connect(service.farm.settings.database)
    with sessions.begin() as session:
        row = session.get(Job, newer)
        assert row is not None and row.settings is not None
        row.settings = row.settings | {"wavelengths": 31}
    engine.dispose()
    service.start()
    assert "wavelengths" in service.wait_for(newer, "failed")["error"]
    service.wait_for(other, "finished")
