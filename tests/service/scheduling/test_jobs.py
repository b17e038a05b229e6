"""Tests of jobs from the request to the finished film, with a real Redis and the real protocol."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from protocol.contract import RenderBatch, render_queue
from renderer import film as film_math
from renderer.settings import Tile
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest, expected_sums


def test_finished_film_has_expected_sums(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), seed=5)
    done = service.wait_for(job, "finished")
    assert done["progress"] == 1.0
    assert done["samples"] == 64 * 48 * 8
    assert service.digest(job) == expected_digest(seed=5)
    pixel = service.http.get(f"/api/jobs/{job}/frames/0/pixel", params={"x": 20, "y": 30}).json()
    assert pixel["samples"] == 8
    sums = expected_sums(Tile(20, 30, 1, 1), 0, 8, 5)
    np.testing.assert_array_equal(np.float32(pixel["color"]), film_math.mean(sums, 24)[0, 0])


@pytest.mark.long
@pytest.mark.parametrize("tile_size", [16, 64])
def test_tile_size_does_not_change_film(service: Service, worker: PeerWorker, tile_size: int) -> None:
    job = service.submit(service.ready_scene(), tile_size=tile_size)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_adding_samples_gives_same_bits(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), spp=3)
    service.wait_for(job, "finished")
    refused = service.http.patch(f"/api/jobs/{job}", json={"spp": 2})
    assert refused.status_code == 409
    assert service.patch(job, spp=8)["state"] == "queued"
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_samples_can_be_added_by_increment(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), spp=3)
    service.wait_for(job, "finished")
    assert service.patch(job, more=2)["spp"] == 5
    assert service.patch(job, more=3)["spp"] == 8
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_converged_noise_job_can_get_more_samples(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), spp=None, noise=0.5)
    done = service.wait_for(job, "finished")
    assert done["samples"] == 64 * 48 * 32, "the first look at the noise is enough"
    refused = service.http.patch(f"/api/jobs/{job}", json={"spp": 32})
    assert refused.status_code == 409
    assert "spp: the job has 32 samples per pixel already; samples can only be added" in refused.json()["detail"]
    assert service.patch(job, more=8)["state"] == "queued"
    assert service.wait_for(job, "finished")["samples"] == 64 * 48 * 40
    assert service.patch(job, spp=48)["spp"] == 48
    assert service.wait_for(job, "finished")["noise"] is None, "it is a job by samples now"
    assert service.digest(job) == expected_digest(spp=48)


@pytest.mark.long
def test_noise_goal_can_be_replaced_while_rendering(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=None, noise=0.0001)
    until(lambda: service.job(job)["samples"] > 0, "the job is under way")
    service.patch(job, spp=40)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=40)


@pytest.mark.long
def test_cancelling_never_reduces_reported_samples(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    scene = service.ready_scene()
    for _ in range(5):
        job = service.submit(scene, spp=4096)
        until(lambda job=job: service.job(job)["samples"] > 0, "the job is under way")  # type: ignore[misc]
        before = service.job(job)
        told = [service.patch(job, state="cancelled"), *(service.job(job) for _ in range(20))]
        assert all(now["state"] == "cancelled" for now in told)
        for number in ("samples", "progress", "active_s"):
            assert min(now[number] for now in told) >= before[number], number


@pytest.mark.long
def test_time_limited_job_can_get_more_samples(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=None, seconds=0.5, tile_size=64)
    has = service.wait_for(job, "finished")["samples"] // (64 * 48)
    assert service.patch(job, more=6)["spp"] == has + 6
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=has + 6)


@pytest.mark.long
def test_job_waits_for_its_scene(service: Service, worker: PeerWorker) -> None:
    go = threading.Event()
    worker.on_prepare = lambda scene: (go.wait(10), None)[1]
    job = service.submit(service.upload(), camera="overview")
    assert service.job(job)["message"]
    assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 409
    go.set()
    service.wait_for(job, "finished")
    assert service.job(job)["settings"]["view"]["fov"] == 60.0


def test_failed_scene_fails_its_jobs(service: Service, worker: PeerWorker) -> None:
    scene = service.upload(b"broken")
    first = service.http.post("/api/jobs", json={"scene": scene})
    until(lambda: service.scene(scene)["status"] == "failed", "the scene fails")
    assert "line 1" in service.scene(scene)["error"]
    if first.status_code == 201:
        assert "line 1" in service.wait_for(first.json()["id"], "failed")["error"]
    refused = service.http.post("/api/jobs", json={"scene": scene})
    assert refused.status_code == 409
    assert "line 1" in refused.json()["detail"]


def test_pause_and_cancel_take_effect_within_a_second(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.1)
    job = service.submit(service.ready_scene(), spp=500)
    until(lambda: len(worker.batches) > 3, "the job is under way")
    service.patch(job, state="paused")
    time.sleep(0.5)
    held = len(worker.batches)
    time.sleep(0.6)
    assert len(worker.batches) == held
    assert worker.redis.llen(render_queue(worker.kind)) == 0
    service.patch(job, state="running")
    until(lambda: len(worker.batches) > held, "the job goes on")
    assert service.patch(job, state="cancelled")["state"] == "cancelled"
    time.sleep(0.5)
    held = len(worker.batches)
    time.sleep(0.6)
    assert len(worker.batches) == held
    done = service.job(job)
    assert done["state"] == "cancelled"
    assert 0 < done["progress"] < 1, "what was rendered stays"
    assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 200


@pytest.mark.long
def test_higher_priority_is_rendered_first(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.03)
    scene = service.ready_scene()
    slow = service.submit(scene, spp=100)
    until(lambda: len(worker.batches) > 2, "the first job is under way")
    late = service.submit(scene, priority=-1)
    until(lambda: "1 job of a higher" in (service.job(late)["message"] or ""), "the later job says what it waits for")
    service.patch(late, state="cancelled")
    urgent = service.submit(scene, priority=5)
    service.wait_for(urgent, "finished")
    assert service.job(slow)["state"] == "running"
    jobs = [b.job for b in worker.batches]
    first, last = jobs.index(urgent), len(jobs) - jobs[::-1].index(urgent)
    assert jobs[first:last].count(slow) <= 4, "no more than what was in the window"


@pytest.mark.long
def test_job_reports_kernel_compilation(service: Service, worker: PeerWorker) -> None:
    go = threading.Event()

    def compiles(batch: RenderBatch) -> None:
        worker.current = {**worker.current, "compiling": True}
        go.wait(20)

    worker.on_batch = compiles
    job = service.submit(service.ready_scene())
    until(lambda: "Compiling renderer" in (service.job(job)["message"] or ""), "the job says what it waits for")
    go.set()
    assert service.wait_for(job, "finished")["message"] is None


@pytest.mark.long
def test_jobs_of_equal_priority_share_workers(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    scene = service.ready_scene()
    jobs = [service.submit(scene, spp=200, seed=seed) for seed in range(3)]
    until(lambda: {batch.job for batch in worker.batches} == set(jobs), "all of them have begun")
    begun = len(worker.batches)
    until(lambda: len(worker.batches) >= begun + 36, "they go on")
    taken = [batch.job for batch in worker.batches[begun : begun + 36]]
    assert all(9 <= taken.count(job) <= 15 for job in jobs), taken
    assert all(service.job(job)["message"] is None for job in jobs)
    for job in jobs:
        service.patch(job, state="cancelled")


@pytest.mark.long
def test_time_limit_ends_job_with_complete_picture(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=None, seconds=1.0)
    done = service.wait_for(job, "finished", timeout=10)
    assert 1.0 <= done["active_s"] < 3.0
    pixels = [service.http.get(f"/api/jobs/{job}/frames/0/pixel", params={"x": x, "y": 40}).json() for x in (0, 63)]
    assert all(pixel["samples"] >= 1 for pixel in pixels)


@pytest.mark.long
def test_noise_goal_ends_tiles_independently(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    jobs = [service.submit(scene, spp=256, noise=0.09, tile_size=16) for _ in range(2)]
    digests = set()
    for job in jobs:
        service.wait_for(job, "finished")
        digests.add(service.digest(job))
        samples = service.job(job)["samples"] / (64 * 48)
        assert 32 <= samples < 256
    assert len(digests) == 1


@pytest.mark.long
def test_scene_is_prepared_for_each_worker_kind(service: Service) -> None:
    with service.worker(kind="old"):
        scene = service.ready_scene()
    with service.worker(kind="new", name="new-one") as new:
        until(lambda: [w["kind"] for w in service.http.get("/api/workers").json()] == ["new"], "the old worker is gone")
        job = service.submit(scene)
        service.wait_for(job, "finished")
        assert new.prepared == [scene]
        assert service.job(job)["kind"] == "new"
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_job_does_not_mix_worker_kinds(service: Service) -> None:
    with service.worker(kind="old") as old:
        old.on_batch = lambda batch: time.sleep(0.1)
        job = service.submit(service.ready_scene(), spp=100)
        until(lambda: len(old.batches) > 1, "the job has begun")
    with service.worker(kind="new", name="new-one") as new:
        until(lambda: "kind old" in (service.job(job)["message"] or ""), "the job says what it waits for")
        assert new.batches == []


@pytest.mark.long
def test_deleting_job_removes_film(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    film = service.options["data"] / "films" / f"{job}.sqlite"
    assert film.exists()
    assert service.http.delete(f"/api/jobs/{job}").status_code == 204
    until(lambda: not film.exists(), "the film is removed")
    assert service.http.get(f"/api/jobs/{job}").status_code == 404


@pytest.mark.long
def test_focus_rectangle_is_first_and_changes_no_bit(service: Service, worker: PeerWorker) -> None:
    """Checks that a job whose focus rectangle is rendered first ends with the same digest as a job without one.

    The rectangle survives a restart of the service.
    """
    worker.on_batch = lambda batch: time.sleep(0.02)
    scene = service.ready_scene()
    plain = service.submit(scene, spp=40)
    service.wait_for(plain, "finished")
    worker.on_batch = lambda batch: time.sleep(0.05)
    job = service.submit(scene, spp=40)
    url = f"/api/jobs/{job}"
    until(lambda: service.job(job)["samples"] > 0, "it begins")
    told = service.http.patch(url, json={"focus": [0, 0, 1, 1]}).raise_for_status().json()
    assert told["focus"] == [0, 0, 1, 1]
    service.restart()

    def corner_and_rest() -> tuple[int, int]:
        answer = service.http.get(f"{url}/frames/0/film", headers={"Accept-Encoding": "identity"}).content
        samples = np.frombuffer(answer, "<u4", 12, 12)
        return int(samples[0]), int(samples[1:].max())

    until(lambda: corner_and_rest()[0] == 40, "the corner has all")
    assert corner_and_rest()[1] < 40, "nobody else has"
    assert service.job(job)["focus"] == [0, 0, 1, 1]
    assert service.http.patch(url, json={"focus": None}).json()["focus"] is None
    service.wait_for(job, "finished")
    digests = [service.http.get(f"/api/jobs/{id}/frames/0/digest").json()["digest"] for id in (plain, job)]
    assert digests[0] == digests[1]
    assert service.http.patch(url, json={"focus": [0, 0, 9, 9]}).status_code == 409
    paused = service.submit(scene, spp=40, priority=-9)
    refused = service.http.patch(f"/api/jobs/{paused}", json={"focus": [999, 0, 9, 9]})
    assert refused.status_code == 422 and "is outside the picture, which is" in refused.json()["detail"]
