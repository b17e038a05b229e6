"""Tests of retention rules: pinned data, and data that is still in use, is kept.

Deleted data that can be rendered again then has the same bits.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import update

from service.maintenance import retention
from service.maintenance.retention import DAY_S
from service.store.models import Job, Scene
from tests.service.conftest import OBJ, Service, until


def set_ages(service: Service, **days: float) -> None:
    """Sets the creation and end times of jobs and scenes, so that they have the given ages in days, by id."""
    for id, age in days.items():
        then = time.time() - age * DAY_S
        with service.farm.sessions.begin() as session:
            session.execute(update(Job).where(Job.id == id).values(created=then, finished=then))
            session.execute(update(Scene).where(Scene.id == id).values(created=then))


def let_go(service: Service, **rules: float) -> list[tuple[str, str]]:
    answer = service.http.post("/api/retention", json={"dry_run": False, **rules})
    assert answer.status_code == 202, answer.text
    return [(item["what"], item["id"]) for item in wait_for_deletion(service, answer.headers["location"])["items"]]


def wait_for_deletion(service: Service, location: str = "/api/retention") -> dict[str, Any]:
    """Waits until the deletion run at `location` has ended, and returns it."""
    runs: list[dict[str, Any]] = []

    def is_over() -> bool:
        runs[:] = [service.http.get(location).raise_for_status().json()]
        return bool(runs[0]["state"] != "running")

    until(is_over, "the run ends")
    return runs[0]


def would_go(service: Service, **rules: float) -> list[tuple[str, str]]:
    answer = service.http.post("/api/retention", json=rules).raise_for_status().json()
    return [(item["what"], item["id"]) for item in answer["items"]]


def film_of(service: Service, job: str) -> Path:
    path: Path = service.options["data"] / "films" / f"{job}.sqlite"
    return path


@pytest.fixture
def jobs(service: Service) -> list[str]:
    """Returns four finished jobs of one scene, 40, 30, 20 and 10 days old; the first is pinned."""
    with service.worker():
        scene = service.ready_scene()
        jobs = [service.submit(scene, seed=seed) for seed in range(4)]
        for job in jobs:
            service.wait_for(job, "finished")
    set_ages(service, **{job: 40.0 - 10 * n for n, job in enumerate(jobs)}, **{scene: 50})
    assert service.patch(jobs[0], pinned=True)["pinned"]
    return jobs


@pytest.mark.long
def test_deleted_film_is_rendered_again_with_same_bits(service: Service, jobs: list[str]) -> None:
    digest = service.digest(jobs[1])
    assert would_go(service) == [], "the farm has no rules of its own"
    assert would_go(service, films_days=15) == [("film", jobs[1]), ("film", jobs[2])], "the pinned one stays"
    assert film_of(service, jobs[1]).exists(), "it was only told"
    assert let_go(service, films_days=25) == [("film", jobs[1])]
    assert not film_of(service, jobs[1]).exists()
    gone = service.job(jobs[1])
    assert gone["state"] == "cancelled"
    error = gone["codes"]["error"]
    assert (error["code"], error["params"]["reason"]["code"]) == ("film-released", "retention-older")
    answer = service.http.get(f"/api/jobs/{jobs[1]}/frames/0/image.png")
    assert answer.status_code == 409
    assert "Set the job to running" in answer.json()["detail"]
    service.restart()
    service.patch(jobs[1], state="running")
    with service.worker():
        service.wait_for(jobs[1], "finished")
    assert service.digest(jobs[1]) == digest
    assert service.job(jobs[1])["error"] is None


@pytest.mark.long
def test_oldest_films_are_deleted_until_limit_is_met(service: Service, jobs: list[str]) -> None:
    all_of_them = sum(service.farm.films.size(job) for job in jobs)
    one = service.farm.films.size(jobs[1])
    assert would_go(service, films_bytes=all_of_them) == []
    assert would_go(service, films_bytes=all_of_them - 1) == [("film", jobs[1])]
    assert would_go(service, films_bytes=all_of_them - one - 1) == [("film", jobs[1]), ("film", jobs[2])]
    assert [id for _, id in would_go(service, films_bytes=0)] == jobs[1:]


@pytest.mark.long
def test_unused_compiled_scenes_and_uploads_are_deleted(service: Service, jobs: list[str]) -> None:
    scene = service.job(jobs[0])["scene"]
    with service.worker():
        other = service.upload(OBJ + b"# other")
        until(lambda: service.scene(other)["status"] == "ready", "the other is prepared")
    set_ages(service, **{other: 30})
    rules = {"compiled_days": 5, "uploads_days": 60}
    assert would_go(service, **rules) == [("compiled", other)], "a pinned job needs the first"
    service.patch(jobs[0], pinned=False)
    assert would_go(service, **rules) == [("compiled", scene), ("compiled", other)]
    service.restart()  # restarts without waiting for reports of what workers stored
    before = service.farm.records.blobs()
    assert len(let_go(service, **rules)) == 2
    kept = service.farm.records.blobs()
    assert kept < before
    for sha256 in before - kept:
        assert not service.farm.blobs.exists(sha256)
    assert service.scene(other)["status"] == "ready"
    with service.worker():
        service.wait_for(service.submit(other), "finished")  # a job that uses it prepares it again
    assert would_go(service, uploads_days=5) == [("upload", scene)], "the other was used just now"
    assert let_go(service, uploads_days=5) == [("upload", scene)]
    assert service.http.get(f"/api/scenes/{scene}").status_code == 404
    assert service.digest(jobs[3]), "pictures stay"


@pytest.mark.long
def test_retention_rules_are_applied_automatically(service: Service, jobs: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(retention, "FIRST_RUN_AFTER_S", 0.0)
    service.options["keep_films_days"] = 15
    service.restart()
    until(lambda: not film_of(service, jobs[2]).exists(), "what is too old is let go")
    assert [film_of(service, job).exists() for job in jobs] == [True, False, False, True]
    with service.farm.sessions.begin() as session:
        session.execute(update(Job).where(Job.id == jobs[3]).values(state="running"))
    assert would_go(service, films_days=0) == [], "what is rendered stays"


@pytest.mark.long
def test_deletion_runs_in_background_with_progress(service: Service, jobs: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert service.http.get("/api/retention").status_code == 404
    go, drop = threading.Event(), service.farm.retention._drop_film

    def slowly(item: retention.Item) -> bool:
        return bool(item.id == jobs[1] or go.wait(20)) and drop(item)

    monkeypatch.setattr(service.farm.retention, "_drop_film", slowly)
    answer = service.http.post("/api/retention", json={"dry_run": False, "films_days": 15})
    assert (answer.status_code, answer.headers["location"], answer.json()["state"]) == (202, "/api/retention", "running")
    until(lambda: service.http.get("/api/retention").json()["done"] == 1, "the first is done")
    now = service.http.get("/api/retention").json()
    assert (now["state"], now["planned"], [item["id"] for item in now["items"]]) == ("running", 2, [jobs[1]])
    again = service.http.post("/api/retention", json={"dry_run": False, "films_days": 15})
    assert (again.status_code, again.json()["code"]) == (409, "retention-already-running")
    go.set()
    done = wait_for_deletion(service)
    assert (done["state"], done["done"], [item["id"] for item in done["items"]]) == ("finished", 2, jobs[1:3])
    assert done["bytes"] == sum(item["bytes"] for item in done["items"]) > 0

    def broken(item: retention.Item) -> bool:
        raise KeyError("a bug")

    monkeypatch.setattr(service.farm.retention, "_drop_film", broken)
    service.http.post("/api/retention", json={"dry_run": False, "films_days": 5}).raise_for_status()
    failed = wait_for_deletion(service)
    assert failed["state"] == "failed" and "KeyError" in failed["error"]
