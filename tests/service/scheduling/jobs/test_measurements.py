"""Tests that the cost and noise measured by one job are reused by the next job of the same scene."""

from __future__ import annotations

import math

import pytest

from service.scheduling.jobs.measurements import updated
from tests.service.conftest import Service
from tests.service.peer_worker import PeerWorker


@pytest.mark.long
def test_scene_stores_cost_and_noise_of_latest_job(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    assert service.scene(scene)["measured"] is None
    service.wait_for(service.submit(scene, spp=64), "finished")
    first = service.scene(scene)["measured"]
    # The peer reports that a batch of n samples of a 16 x 16 tile took n milliseconds.
    assert first["sample_s"] == pytest.approx(0.001 / 256)
    service.wait_for(service.submit(scene, spp=256), "finished")
    second = service.scene(scene)["measured"]
    assert second["sample_s"] == pytest.approx(first["sample_s"])
    assert first["noise"] > 0.0
    assert math.isclose(first["noise"], second["noise"], rel_tol=0.5), "at one sample, however many there were"


def test_too_few_samples_give_no_measurement(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    service.wait_for(service.submit(scene, width=16, height=16, spp=16), "finished")
    assert service.scene(scene)["measured"] is None


def test_slower_measurement_of_busy_machine_counts_little() -> None:
    fast, slow = {"sample_s": 1.0, "noise": 0.5}, {"sample_s": 8.0, "noise": 0.4}
    assert updated(None, slow) == slow
    assert updated(slow, fast) == fast, "other work only slows a machine down"
    assert updated(fast, slow) == {"sample_s": pytest.approx(2.0), "noise": 0.4}
    kept = fast
    for _ in range(10):
        kept = updated(kept, slow)
    assert kept["sample_s"] == pytest.approx(8.0, rel=0.05), "settings that cost more are adopted after some pictures"
