"""Tests of a job's history: it has enough points for a plot, and takes a few kilobytes at most."""

from __future__ import annotations

import json
import time

import pytest

from service.scheduling.jobs.history import MAX_EVENTS, MAX_POINTS, History
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker


def test_history_is_bounded_and_keeps_first_and_last_point() -> None:
    history = History()
    for i in range(1, 100_000, 7):
        history.add_point(i / 10, i, 1 / i**0.5)
        history.add_event("lost", str(i))
    assert len(history.points) <= MAX_POINTS and len(history.events) == MAX_EVENTS
    assert history.points[0][1] == 1 and (history.points[-1][1] or 0) > 90_000
    assert history.events[0][2] == "1" and history.events[-1][2] == "99996"
    assert [p[1] for p in history.points] == sorted(p[1] or 0 for p in history.points)
    assert len(json.dumps(history.to_json())) < 16_000
    assert History.parse(history.to_json()).to_json() == history.to_json()


def test_end_is_always_a_point() -> None:
    history = History()
    history.add_point(1.0, 1000, 0.1)
    history.add_point(1.1, 1001, 0.1)
    assert [samples for _, samples, _ in history.points] == [1000]
    for _ in range(2):
        history.add_point(1.1, 1001, 0.1, is_end=True)
    assert [samples for _, samples, _ in history.points] == [1000, 1001]


def test_worker_events_are_added_once() -> None:
    history = History()
    for _ in range(3):
        history.rendered_by("a")
        history.rendered_by("b")
    history.record_departures({"b"})
    again = History.parse(history.to_json())
    again.rendered_by("b")
    again.rendered_by("a")
    assert [tuple(event[1:]) for event in again.events] == [("worker", "a"), ("worker", "b"), ("left", "a"), ("worker", "a")]


def test_invalid_history_starts_empty() -> None:
    assert History.parse({"points": [[1, "x", 2]], "events": []}).points == []
    assert History.parse({"points": 3}).events == []


@pytest.mark.long
def test_job_has_history_of_its_rendering(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.01)
    job = service.submit(service.ready_scene(), spp=64)
    until(lambda: service.job(job)["samples"] > 0, "it begins")
    service.patch(job, state="paused")
    until(lambda: service.job(job)["state"] == "paused", "it pauses")
    time.sleep(1.2)
    service.patch(job, state="running")
    service.wait_for(job, "finished")
    found = service.http.get(f"/api/jobs/{job}/history").raise_for_status().json()
    kinds = [event["kind"] for event in found["events"]]
    assert kinds[0] == "begun" and {"worker", "picture", "paused"} <= set(kinds)
    assert [event["at"] for event in found["events"]] == sorted(event["at"] for event in found["events"])
    last = found["points"][-1]
    assert last["spp"] == 64 and last["noise"] is not None and last["noise"] > 0
