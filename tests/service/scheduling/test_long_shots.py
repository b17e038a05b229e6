"""Tests of shots with very many frames. Changes are carried out in several transactions, with the same result as in one.

A killed service leaves no change half done.
"""

from __future__ import annotations

import threading
from typing import Any

import pytest
from sqlalchemy import func, select

from service.scheduling.loading import Loading
from service.store import frame_changes
from service.store.frame_changes import FrameChanges
from service.store.models import Frame, FrameChange, Job
from tests.service.conftest import Service, until

SIZE = {"width": 16, "height": 16, "tile_size": 16, "spp": 4}
LAST = 119
PARTS = 25  # frames per part in these tests
COLUMNS = ("number", "samples", "target", "bad_samples", "progress", "state", "error", "noise", "spp", "settings")


class KilledError(Exception):
    """Simulates the end of the process."""


def submit_shot(service: Service, scene: str, frames: str = f"0-{LAST}", key: str = "") -> Any:
    headers = {"Idempotency-Key": key} if key else {}
    return service.http.post("/api/jobs", json={"scene": scene, "frames": frames, **SIZE}, headers=headers)


def rows(service: Service, job: str) -> list[tuple[Any, ...]]:
    query = select(*(getattr(Frame, name) for name in COLUMNS)).where(Frame.job == job).order_by(Frame.number)
    with service.farm.sessions() as session:
        return [tuple(row) for row in session.execute(query)]


def is_at_rest(service: Service, job: str) -> bool:
    """Returns True if the job has no pending changes and the engine has loaded it."""
    with service.farm.sessions() as session:
        return session.get(FrameChange, job) is None and job in service.farm.engine.snapshot.jobs


@pytest.fixture
def scene(service: Service) -> str:
    with service.worker():
        ready = service.ready_scene()
    until(lambda: not service.http.get("/api/workers").json(), "the worker is gone")  # else it is sent a frame
    return ready


@pytest.mark.long
def test_change_in_portions_equals_single_transaction(service: Service, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    changes: list[dict[str, Any]] = [
        {"extend": "100-170"},
        {"more": 3, "frames": "10-90"},
        {"spp": 6},
        {"again": f"0-{LAST}", "first": 7},
        {"order": "noisiest-first", "spp": 9},
        {"order": "in-turn"},
        {"again": "0-60x2", "extend": "200-300x3", "priority": 5},
    ]
    jobs = []
    for parts in (PARTS, 10_000):
        monkeypatch.setattr(frame_changes, "AT_A_TIME", parts)
        made = submit_shot(service, scene).raise_for_status().json()
        jobs.append(made["id"])
        assert (made["shot"]["count"], made["shot"]["frames"], made["shot"]["states"]) == (120, "0-119", {"queued": 120})
        with service.farm.sessions.begin() as session:
            for frame in session.scalars(select(Frame).where(Frame.job == made["id"], Frame.number % 14 == 0)):
                frame.state, frame.error, frame.spp = "failed", "broken", 5
            for frame in session.scalars(select(Frame).where(Frame.job == made["id"], Frame.number % 10 == 0)):
                frame.samples, frame.progress, frame.noise = 512, 0.5, 0.25
        for number, change in enumerate(changes):
            answer = service.patch(made["id"], **change)
            assert is_at_rest(service, made["id"]) or until(lambda: is_at_rest(service, jobs[-1]), "it is taken up") is None
            assert len(rows(service, made["id"])) == answer["shot"]["count"], number
    assert rows(service, jobs[0]) == rows(service, jobs[1])
    first, second = (service.job(job) for job in jobs)
    assert {**first["shot"]} == {**second["shot"]}
    assert first["shot"]["frames"] == "0-170,200-300x3" or first["shot"]["count"] == 171 + 34
    for job in jobs:
        assert service.http.delete(f"/api/jobs/{job}").status_code == 204
        assert service.http.get(f"/api/jobs/{job}").status_code == 404
        assert not rows(service, job)


@pytest.mark.long
def test_accepted_change_is_completed_after_restart(service: Service, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_changes, "AT_A_TIME", PARTS)
    parts, next_part = [0], FrameChanges._apply_next

    def some(self: FrameChanges, *arguments: Any) -> bool:
        parts[0] += 1
        if parts[0] > 2:
            raise KilledError
        return next_part(self, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(FrameChanges, "_apply_next", some)
        assert submit_shot(service, scene, key="once").status_code == 500
        service.stop()
    service.start()
    job = submit_shot(service, scene, key="once").raise_for_status().json()["id"]
    until(lambda: is_at_rest(service, job), "it is taken up")
    assert [row[:3] for row in rows(service, job)] == [(2 * n, 0, 4 * 16 * 16) for n in range(LAST + 1)]
    with service.farm.sessions() as session:
        assert session.scalar(select(func.count()).select_from(Job)) == 1

    parts[0] = 0
    with monkeypatch.context() as patched:
        patched.setattr(FrameChanges, "_apply_next", some)
        assert service.http.patch(f"/api/jobs/{job}", json={"spp": 8}).status_code == 500
        service.stop()
    service.start()
    until(lambda: is_at_rest(service, job), "it is taken up")
    assert {row[2] for row in rows(service, job)} == {8 * 16 * 16}


@pytest.mark.long
def test_interrupted_deletion_is_completed(service: Service, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_changes, "AT_A_TIME", PARTS)
    monkeypatch.setattr("service.maintenance.deleting.AT_A_TIME", PARTS)
    job = submit_shot(service, scene).raise_for_status().json()["id"]

    def killed(self: FrameChanges, began: float) -> None:
        raise KilledError

    with monkeypatch.context() as patched:
        patched.setattr(FrameChanges, "_pause", killed)
        answer = service.http.delete(f"/api/jobs/{job}")
        assert (answer.status_code, answer.headers["connection"]) == (500, "close"), "or the next request would be cut off"
        assert len(rows(service, job)) == LAST + 1 - PARTS
        assert service.job(job)["state"] == "cancelled"
        service.stop()
    service.start()
    until(lambda: service.http.get(f"/api/jobs/{job}").status_code == 404, "it is gone")
    assert not rows(service, job)


@pytest.mark.long
def test_long_shot_is_loaded_in_steps(service: Service, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.scheduling.loading.ROUND_PROCESSOR_S", -1.0)  # one step per round
    monkeypatch.setattr("service.scheduling.records.AT_A_TIME", 10)
    monkeypatch.setattr("service.scheduling.jobs.active_job.FRAMES_PER_STEP", 10)
    rounds: list[bool] = []
    go_on = Loading.continue_loading

    def slowly(self: Loading, row: Job) -> bool:
        rounds.append(go_on(self, row))
        if not may_go_on.is_set():
            other_done.wait(0.05)
        return rounds[-1]

    other_done, may_go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(Loading, "continue_loading", slowly)
    shot = submit_shot(service, scene).raise_for_status().json()["id"]
    until(lambda: len(rounds) > 2, "it is begun to be taken up")
    assert shot not in service.farm.engine.snapshot.jobs
    assert service.patch(shot, priority=7, name="later")["priority"] == 7
    may_go_on.set()
    until(lambda: is_at_rest(service, shot), "it is taken up")
    assert rounds.count(False) >= 20, "twelve steps of reading, and as many of adding up"
    assert service.farm.engine._scheduler.jobs[shot].priority == 7, "what was changed meanwhile"
    with service.worker():
        still = service.submit(scene, width=16, height=16, tile_size=16, spp=1, priority=50)
        service.wait_for(still, "finished")
        service.wait_for(shot, "finished", 60)
    assert service.job(shot)["shot"]["states"] == {"finished": LAST + 1}


def test_frames_are_paginated_and_filtered_by_state(service: Service, scene: str) -> None:
    job = submit_shot(service, scene, "0-30").raise_for_status().json()["id"]
    path = f"/api/jobs/{job}/frames"
    every = service.http.get(path).raise_for_status().json()
    assert [frame["number"] for frame in every] == list(range(31))
    assert service.http.get(path, params={"offset": 7, "limit": 5}).json() == every[7:12]
    assert service.http.get(path, params={"state": "queued", "offset": 29}).json() == every[29:]
    assert service.http.get(path, params={"state": "failed"}).json() == []
