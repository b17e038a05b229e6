"""Tests of jobs that reuse the samples of another job's film.

A job never has more samples than requested, nor different bits; the jobs' noise goals do not affect each other.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from renderer.frames import parse_frames
from service.maintenance import reuse
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest

LONG_S = 120.0


@pytest.fixture
def service(service: Service) -> Iterator[Service]:
    """Yields a service that reuses films, which is the default."""
    service.stop()
    service.options["reuse_films"] = True
    service.start()
    return service


def samples_of(worker: PeerWorker, job: str) -> int:
    """Returns the number of samples, over all pixels, that a worker has rendered for a job."""
    return sum(batch.count * batch.tile.w * batch.tile.h for batch in worker.batches if batch.job == job)


@pytest.mark.long
def test_equal_job_reuses_all_samples(service: Service) -> None:
    with service.worker() as worker:
        scene = service.ready_scene()
        first = service.submit(scene)
        service.wait_for(first, "finished", LONG_S)
    noise = service.job(first)["frames"][0]["noise"]
    again = service.submit(scene)  # no worker is there to render it
    found = service.wait_for(again, "finished", LONG_S)
    assert found["frames"][0]["noise"] == noise > 0
    assert found["taken"] == {"job": first, "spp": 8.0, "samples": 64 * 48 * 8, "frames": None}
    assert (found["samples"], found["kind"]) == (64 * 48 * 8, "test-kind")
    assert service.http.delete(f"/api/jobs/{first}").status_code == 204
    until(lambda: not service.farm.films.size(first), "the first film is gone", LONG_S)
    assert service.digest(again) == expected_digest()
    assert service.http.get(f"/api/jobs/{again}/frames/0/image.png").status_code == 200
    assert not samples_of(worker, again)
    events = service.http.get(f"/api/jobs/{again}/history").json()["events"]
    assert ("taken", first) in [(event["kind"], event["words"]) for event in events]


def test_more_samples_reuse_existing_ones_with_same_bits(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    few = service.submit(scene, spp=16)
    service.wait_for(few, "finished", LONG_S)
    many = service.submit(scene, spp=64)
    found = service.wait_for(many, "finished", LONG_S)
    assert (found["taken"]["job"], found["taken"]["spp"]) == (few, 16.0)
    assert samples_of(worker, many) == 64 * 48 * 48
    fresh = service.submit(scene, spp=64, fresh=True)
    assert service.wait_for(fresh, "finished", LONG_S)["taken"] is None
    assert samples_of(worker, fresh) == 64 * 48 * 64
    assert service.digest(many) == service.digest(fresh) == expected_digest(spp=64)


@pytest.mark.long
def test_samples_that_change_bits_are_not_reused(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    service.wait_for(service.submit(scene, spp=16), "finished", LONG_S)

    def taken(**request: object) -> bool:
        job = service.submit(scene, **request)
        return service.job(job)["taken"] is not None

    assert not taken(spp=8), "samples are never taken away"
    assert not taken(spp=16, seed=1)
    assert not taken(spp=16, max_depth=3)
    assert not taken(spp=16, width=32)
    assert not taken(spp=16, tile_size=32)
    assert not taken(spp=16, camera="overview")
    assert not taken(spp=16, seconds=30), "who asks for a time asks for work"
    assert not taken(spp=16, verify=0.5), "what is to be looked at is rendered for it"
    assert taken(spp=32)
    other = service.upload(b"v 0 0 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    until(lambda: service.scene(other)["status"] == "ready", "another scene is prepared", LONG_S)
    assert service.job(service.submit(other, spp=16))["taken"] is None


@pytest.mark.long
def test_samples_of_other_worker_kind_are_not_reused(service: Service) -> None:
    with service.worker(name="old", kind="old-kernels"):
        scene = service.ready_scene()
        first = service.submit(scene)
        service.wait_for(first, "finished", LONG_S)
    with service.worker(name="new", kind="new-kernels"):
        until(
            lambda: [w["name"] for w in service.http.get("/api/workers").json()] == ["new"],
            "the other worker is there alone",
            LONG_S,
        )
        again = service.submit(scene, spp=16)
        found = service.wait_for(again, "finished", LONG_S)
    assert (found["taken"], found["kind"]) == (None, "new-kernels")


@pytest.mark.long
def test_lower_noise_goal_reuses_samples_of_higher_one(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    digests = {}
    for noise, fresh in ((0.09, True), (0.05, False), (0.05, True)):
        job = service.submit(scene, spp=None, noise=noise, fresh=fresh)
        found = service.wait_for(job, "finished", LONG_S)
        digests[noise, fresh] = job, service.digest(job), found["taken"]
    assert digests[0.05, False][2]["job"] == digests[0.09, True][0]
    assert digests[0.05, True][1] == digests[0.05, False][1] != digests[0.09, True][1]
    coarse = service.submit(scene, spp=None, noise=0.09)
    assert service.job(coarse)["taken"]["job"] == digests[0.09, True][0], "of the finer some tiles have too many"


SHOT = {"width": 32, "height": 24, "tile_size": 16, "spp": 4}


def frame_digests(service: Service, job: str, frames: str) -> list[str]:
    """Returns the digests of a job's frames, in the order of `frames`, which is a list in text form such as 0-3."""
    urls = [f"/api/jobs/{job}/frames/{number}/digest" for number in parse_frames(frames)]
    return [service.http.get(url).raise_for_status().json()["digest"] for url in urls]


def expected_frames(frames: str, spp: int = 4) -> list[str]:
    """Returns the expected digests of the given frames of a job with the request SHOT, with `spp` samples per pixel."""
    return [expected_digest(32, 24, spp, round(2000 * number)) for number in parse_frames(frames)]


@pytest.mark.long
def test_equal_shot_reuses_all_frames(service: Service) -> None:
    with service.worker() as worker:
        scene = service.ready_scene()
        first = service.submit(scene, **SHOT, frames="0-3")
        service.wait_for(first, "finished", LONG_S)
    again = service.submit(scene, **SHOT, frames="1-3", order="breadth-first")  # no worker is there to render it
    found = service.wait_for(again, "finished", LONG_S)
    assert found["taken"] == {"job": first, "spp": 4.0, "samples": 3 * 32 * 24 * 4, "frames": "1-3"}
    assert (found["shot"]["states"], found["progress"]) == ({"finished": 3}, 1.0)
    assert not samples_of(worker, again)
    assert service.http.delete(f"/api/jobs/{first}").status_code == 204
    until(lambda: not service.farm.films.size(first), "the first film is gone", LONG_S)
    assert frame_digests(service, again, "1-3") == expected_frames("1-3")


@pytest.mark.long
def test_shot_reuses_frames_of_several_jobs(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = service.ready_scene()
    head, tail = (service.submit(scene, **SHOT, frames=frames) for frames in ("0-1", "4"))
    for job in (head, tail):
        service.wait_for(job, "finished", LONG_S)
    whole = service.submit(scene, **SHOT, frames="0-4")
    found = service.wait_for(whole, "finished", LONG_S)
    assert (found["taken"]["job"], found["taken"]["frames"]) == (head, "0-1,4")
    assert {batch.frame / 2 for batch in worker.batches if batch.job == whole} == {2, 3}
    assert sorted(worker.frames) == [0, 1, 2, 3, 4], "what is taken is not prepared again"
    assert frame_digests(service, whole, "0-4") == expected_frames("0-4")
    more = service.submit(scene, **{**SHOT, "spp": 16}, frames="0-4")
    assert service.wait_for(more, "finished", LONG_S)["taken"]["frames"] == "0-4"
    assert samples_of(worker, more) == 5 * 32 * 24 * 12, "it goes on from the four that are there"
    assert frame_digests(service, more, "0-4") == expected_frames("0-4", 16)
    monkeypatch.setattr(reuse, "PATIENCE_S", 0.0)
    hurried = service.submit(scene, **SHOT, frames="1-3")
    assert service.wait_for(hurried, "finished", LONG_S)["taken"]["frames"] == "1", (
        "who asks does not wait for all of a long shot"
    )
    assert frame_digests(service, hurried, "1-3") == expected_frames("1-3")


@pytest.mark.long
def test_shot_samples_that_change_bits_are_not_reused(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    service.wait_for(service.submit(scene, **SHOT, frames="0-1", fps=24), "finished", LONG_S)

    def taken(**request: Any) -> bool:
        return service.job(service.submit(scene, **{**SHOT, "frames": "0-1", "fps": 24, **request}))["taken"] is not None

    assert taken(), "asked for alike"
    assert not taken(fps=25)
    assert not taken(spp=2), "samples are never taken away"
    assert not taken(turntable=4.0)
    assert not taken(camera="overview")
    assert not taken(frames="2-3")
    assert not taken(order="noisiest-first"), "what a frame gets of the samples hangs on the others"
    assert not taken(fresh=True)


@pytest.mark.long
def test_damaged_film_is_not_reused(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    first = service.submit(scene)
    service.wait_for(first, "finished", LONG_S)
    service.options["film_check_days"] = 0
    service.restart()
    path: Path = service.options["data"] / "films" / f"{first}.sqlite"
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE part SET sums = zeroblob(length(sums)) WHERE tile = 3")
    database.close()
    again = service.submit(scene)
    assert service.wait_for(again, "finished", LONG_S)["taken"] is None
    assert service.digest(again) == expected_digest()
    assert not [path for path in path.parent.iterdir() if ".new" in path.name]
