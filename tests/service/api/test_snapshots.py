"""Tests that a snapshot of a job in progress, requested later, equals the picture at the snapshot's time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO
import pytest

from protocol.contract import RenderBatch
from protocol.pictures import FilmHead, decode_film
from renderer import film as film_math
from renderer.image import rgbe9995
from renderer.settings import Tile
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_sums

WIDTH, HEIGHT, SIDE = 40, 24, 16
TILES = 6
EXPONENT = 24


def expected_words(samples: int) -> np.ndarray:
    """Returns the expected picture as RGB9E5 words (h, w), with `samples` samples in every pixel."""
    sums = expected_sums(Tile(0, 0, WIDTH, HEIGHT), 0, samples, 0)
    return rgbe9995.pack(film_math.mean(sums, EXPONENT))


def snapshot_samples(service: Service, job: str) -> list[int]:
    return [each["spp"] for each in service.http.get(f"/api/jobs/{job}/snapshots").raise_for_status().json()]


def wait_for_snapshots(service: Service, worker: PeerWorker) -> list[str]:
    """Makes the worker wait, before it renders on from 1 or 8 samples per pixel, until a snapshot of these is stored.

    Returns an empty list, to which a test adds the id of its job.
    """
    jobs: list[str] = []

    def wait(batch: RenderBatch) -> None:
        if batch.first in (1, 8):
            until(lambda: bool(jobs) and batch.first in service.farm.snapshots.stored_spp(jobs[0]), f"{batch.first} is kept")

    worker.on_batch = wait
    return jobs


@pytest.mark.long
def test_snapshots_are_stored_and_survive_restart(service: Service, tmp_path: Path) -> None:
    with service.worker(several=False) as worker:
        jobs = wait_for_snapshots(service, worker)
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=SIDE, spp=64)
        jobs.append(job)
        service.wait_for(job, "finished")
        assert snapshot_samples(service, job)[:2] == [1, 8], "batches have seven times what there is"
        service.restart()
    found = service.http.get(f"/api/jobs/{job}/snapshots").json()
    assert [(each["spp"], each["least"], each["most"], each["samples"]) for each in found[:2]] == [
        (1, 1, 1, WIDTH * HEIGHT),
        (8, 8, 8, 8 * WIDTH * HEIGHT),
    ]
    assert 0 < found[0]["seconds"] <= found[1]["seconds"]
    assert 64 not in snapshot_samples(service, job), "that is the picture itself"

    url = f"/api/jobs/{job}/snapshots/8"
    for encoding in ("gzip", "identity"):
        answer = service.http.get(f"{url}/film", headers={"Accept-Encoding": encoding}).raise_for_status()
        assert answer.headers.get("content-encoding", "identity") == encoding
        film = decode_film(answer.content)
        assert (film.head, film.samples.tolist()) == (FilmHead(0, WIDTH, HEIGHT, SIDE), [8] * TILES)
        np.testing.assert_array_equal(film.words, expected_words(8))
        etag = answer.headers["etag"]
        same = service.http.get(f"{url}/film", headers={"Accept-Encoding": encoding, "If-None-Match": etag})
        assert same.status_code == 304

    exr = service.http.get(f"{url}/image.exr").raise_for_status()
    assert "8spp.exr" in exr.headers["content-disposition"]
    (tmp_path / "kept.exr").write_bytes(exr.content)
    picture = OpenImageIO.ImageInput.open(str(tmp_path / "kept.exr"))
    np.testing.assert_array_equal(picture.read_image(0, 0, 0, 3, OpenImageIO.FLOAT), rgbe9995.unpack(expected_words(8)))
    assert service.http.get(f"{url}/image.jpg?exposure=1&tonemap=hue").status_code == 200
    assert service.http.get(f"{url}/image.jpg?tonemap=none-such").status_code == 422

    missing = service.http.get(f"/api/jobs/{job}/snapshots/3/film")
    assert missing.status_code == 404 and "at 3 samples" in missing.json()["detail"]
    service.http.delete(f"/api/jobs/{job}").raise_for_status()
    until(lambda: service.farm.snapshots.stored_spp(job) == [], "they go with the job")
    assert service.http.get(f"/api/jobs/{job}/snapshots").status_code == 404


@pytest.mark.long
def test_continued_job_stores_further_snapshots(service: Service) -> None:
    with service.worker(several=False) as worker:
        jobs = wait_for_snapshots(service, worker)
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=SIDE, spp=8)
        jobs.append(job)
        service.wait_for(job, "finished")
        assert snapshot_samples(service, job) == [1]
        service.patch(job, spp=32)
        until(lambda: service.job(job)["state"] == "finished" and service.job(job)["spp"] == 32, "it has 32")
        assert snapshot_samples(service, job)[1] == 8, "once it is no longer the picture itself"


@pytest.mark.long
def test_shots_have_no_snapshots(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), width=16, height=16, spp=4, frames="0-1")
    service.wait_for(job, "finished")
    assert snapshot_samples(service, job) == []
