"""Tests of messages with several batches. Only workers that support them get them, and a lost worker loses no samples."""

from __future__ import annotations

import threading
import time

import pytest

from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker
from tests.service.scheduling.test_shots import digest, expected, submit_shot


@pytest.mark.long
def test_short_batches_are_grouped_if_all_workers_support_it(service: Service) -> None:
    with service.worker(name="one") as one:
        scene = service.ready_scene()
        job = submit_shot(service, scene, "0-39", spp=1)
        service.wait_for(job, "finished")
        assert len(one.batches) == 4 * 40
        assert max(one.messages) > 2
        with service.worker(name="older", several=False) as older:
            one.messages.clear()
            until(lambda: len(service.http.get("/api/workers").json()) == 2, "the other is there")
            again = submit_shot(service, scene, "0-19", spp=1, seed=7)
            service.wait_for(again, "finished")
            assert set(one.messages + older.messages) == {1}
    assert [digest(service, job, n) for n in range(40)] == [expected(n, 1) for n in range(40)]


@pytest.mark.long
def test_grouped_batches_of_lost_worker_are_rendered_by_others(service: Service) -> None:
    with service.worker(name="first") as first:
        job = submit_shot(service, service.ready_scene(), "0-29", spp=1)
        stop = threading.Event()
        first.on_batch = lambda batch: (stop.set(), False)[1] if first.messages[-1] > 2 else None
        until(stop.is_set, "it has several in hand")
    with service.worker(name="second") as second:
        service.wait_for(job, "finished", 30)
        assert second.batches
    assert [digest(service, job, n) for n in range(30)] == [expected(n, 1) for n in range(30)]


def begin_long_messages(service: Service, worker: PeerWorker, scene: str) -> str:
    """Submits a shot, and returns its id once the worker renders a message that takes longer than other work may wait."""
    worker.sample_s = 0.1
    job = submit_shot(service, scene, "0-199", spp=1)
    until(lambda: max(worker.messages, default=0) > 20, "a message is long, as no other work waits")
    worker.on_batch = lambda batch: time.sleep(0.05)
    sent = len(worker.messages)
    until(lambda: max(worker.messages[sent:], default=0) > 20, "it renders one slowly")
    return job


@pytest.mark.long
def test_long_messages_are_recalled_when_another_job_comes(service: Service) -> None:
    with service.worker(recalls=True) as worker:
        scene = service.ready_scene()
        job = begin_long_messages(service, worker, scene)
        other = submit_shot(service, scene, "0-3", spp=1, seed=7)
        until(lambda: bool(worker.recalled), "its slot returns what it has not begun")
        service.wait_for(other, "finished", 30)
        assert service.job(job)["state"] == "running"
        worker.on_batch = lambda batch: None
        service.wait_for(job, "finished", 60)
        assert len(worker.batches) == 4 * 200 + 4 * 4, "nothing is rendered twice"
    assert [digest(service, job, n) for n in range(0, 200, 7)] == [expected(n, 1) for n in range(0, 200, 7)]


@pytest.mark.long
def test_long_messages_of_a_paused_job_are_recalled(service: Service) -> None:
    with service.worker(recalls=True) as worker:
        job = begin_long_messages(service, worker, service.ready_scene())
        service.http.patch(f"/api/jobs/{job}", json={"state": "paused"}).raise_for_status()
        until(lambda: bool(worker.recalled), "its slot returns what it has not begun")
        worker.on_batch = lambda batch: None
        service.http.patch(f"/api/jobs/{job}", json={"state": "running"}).raise_for_status()
        service.wait_for(job, "finished", 60)
    assert [digest(service, job, n) for n in range(0, 200, 7)] == [expected(n, 1) for n in range(0, 200, 7)]
