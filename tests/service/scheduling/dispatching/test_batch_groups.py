"""Tests of messages with several batches. Only workers that support them get them, and a lost worker loses no samples."""

from __future__ import annotations

import threading

import pytest

from tests.service.conftest import Service, until
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
