"""Tests that the cost and noise measured by one job are reused by the next job of the same scene."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from service.scheduling.jobs.measurements import measured, updated, with_denoising
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
    fast, slow = {"sample_s": 1.0, "noise": 0.5, "pace": 1.0}, {"sample_s": 8.0, "noise": 0.4, "pace": 2.0}
    assert updated(None, slow) == slow
    assert updated(slow, fast) == fast, "other work only slows a machine down"
    assert updated(fast, slow) == {"sample_s": pytest.approx(2.0), "noise": 0.4, "pace": pytest.approx(2 ** (1 / 3))}
    kept = updated({**fast, "denoise_s": 1.0}, {**slow, "pace": None})
    assert (kept["pace"], kept["denoise_s"]) == (1.0, 1.0), "a job that was too short leaves what longer ones measured"
    kept = {**fast}
    for _ in range(10):
        kept = updated(kept, slow)
    assert kept["sample_s"] == pytest.approx(8.0, rel=0.05), "settings that cost more are adopted after some pictures"


@pytest.mark.parametrize(("active_s", "pace"), [(2.9, None), (10.5, 2.0), (3.5, 1.0), (40.0, None)])
def test_pace_is_of_jobs_that_had_the_slots(active_s: float, pace: float | None) -> None:
    """A job that shared the slots with others would triple the expected time of the next one."""
    job: Any = SimpleNamespace(rendered=100, samples=100, rendered_s=10.0, active_s=active_s, frames={})
    found = measured(job, slots=2)
    assert found is not None and found["pace"] == pace


def test_small_pictures_do_not_tell_how_long_a_large_one_is_denoised() -> None:
    known = {"sample_s": 1.0}
    assert with_denoising(None, 1.0, 1_000_000) is None
    assert with_denoising(known, 1.0, 64 * 48) == known, "a picture so small would predict five minutes for a megapixel"
    assert with_denoising(known, 0.3, 200_000) == known
    assert with_denoising(known, 10.5, 1_000_000) == {**known, "denoise_s": pytest.approx(1e-5)}
