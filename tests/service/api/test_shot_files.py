"""Tests of downloading a shot as one file: a zip that is streamed while frames finish, or a movie."""

from __future__ import annotations

import io
import threading
import zipfile
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from tests.grids import grid
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker

SHOT = {"width": 96, "height": 64, "spp": 4, "frames": "0-3,4.5"}
NAMES = ["scene.0000.png", "scene.0001.png", "scene.0002.png", "scene.0003.png", "scene.0004.5.png"]


@pytest.fixture
def shot(service: Service, worker: PeerWorker) -> str:
    job = service.submit(service.ready_scene(), **SHOT, fps=12.0)
    service.wait_for(job, "finished")
    return job


@pytest.mark.long
def test_zip_has_numbered_frames(service: Service, shot: str) -> None:
    answer = service.http.get(f"/api/jobs/{shot}/frames.zip?format=png").raise_for_status()
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert archive.namelist() == NAMES
        assert archive.testzip() is None
        for name, frame in zip(NAMES, (0, 1, 2, 3, 4.5), strict=True):
            assert archive.read(name) == service.http.get(f"/api/jobs/{shot}/frames/{frame}/image.png").content
    assert answer.headers["content-disposition"].endswith('.png.zip"')
    layers = service.http.get(f"/api/jobs/{shot}/frames.zip?aov=normal&frames=1-2").raise_for_status()
    assert layers.headers["content-disposition"].endswith('.1-2.exr.zip"')
    with zipfile.ZipFile(io.BytesIO(layers.content)) as archive:
        assert archive.namelist() == ["scene.0001.exr", "scene.0002.exr"]
        assert b"Normal.X" in archive.read("scene.0002.exr")[:2000]


@pytest.mark.long
def test_zip_streams_frames_as_they_finish(service: Service, worker: PeerWorker) -> None:
    gate = threading.Event()
    worker.on_batch = lambda batch: (batch.frame < 4 or gate.wait(20)) and None
    job = service.submit(service.ready_scene(), **SHOT)
    until(lambda: service.job(job)["shot"]["states"].get("finished") == 2, "two frames are there")
    url = f"/api/jobs/{job}/frames.zip"
    now = service.http.get(url, params={"format": "png"}).raise_for_status()
    with zipfile.ZipFile(io.BytesIO(now.content)) as archive:
        assert archive.namelist() == NAMES[:2]
    with service.http.stream("GET", url, params={"format": "png", "which": "coming"}) as answer:
        came = b""
        for chunk in answer.iter_bytes():
            came += chunk
            if NAMES[1].encode() in came:
                gate.set()  # the first two frames have arrived before the rest is rendered
    with zipfile.ZipFile(io.BytesIO(came)) as archive:
        assert sorted(archive.namelist()) == NAMES


@pytest.mark.long
@grid("kind", ["mp4", "webm", "webp"], ordinary=("mp4",))
def test_movie_frames_equal_pictures(service: Service, shot: str, kind: str, tmp_path: Path) -> None:
    answer = service.http.get(f"/api/jobs/{shot}/movie.{kind}?exposure=0.5").raise_for_status()
    path = tmp_path / f"shot.{kind}"
    path.write_bytes(answer.content)
    if kind == "webp":
        with Image.open(path) as image:
            image.load()
            assert (image.n_frames, image.size, image.info["duration"]) == (5, (96, 64), 83)
            found = np.asarray(image.convert("RGB"))
    else:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            assert stream.average_rate == 12
            frames = list(container.decode(stream))
            assert len(frames) == 5
            found = frames[0].reformat(format="rgb24").to_ndarray()
    still = service.http.get(f"/api/jobs/{shot}/frames/0/image.png?exposure=0.5").content
    with Image.open(io.BytesIO(still)) as image:
        expected = np.asarray(image.convert("RGB"))
    assert abs(found.astype(float).mean(axis=(0, 1)) - expected.mean(axis=(0, 1))).max() < 3


def test_empty_downloads_give_error(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: False
    job = service.submit(service.ready_scene(), **SHOT)
    for path in ("frames.zip", "frames.zip?which=all", "movie.mp4"):
        answer = service.http.get(f"/api/jobs/{job}/{path}")
        assert answer.status_code == 409
        assert answer.json()["detail"].startswith("No frame")
    assert service.http.get(f"/api/jobs/{job}/frames.zip?frames=x").status_code == 422
    assert service.http.get("/api/jobs/nothing/movie.mp4").status_code == 404


@pytest.mark.long
def test_still_gives_movie_of_one_frame(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    with zipfile.ZipFile(io.BytesIO(service.http.get(f"/api/jobs/{job}/frames.zip").content)) as archive:
        assert archive.namelist() == ["scene.0000.exr"]
    assert service.http.get(f"/api/jobs/{job}/movie.mp4").headers["x-frames"] == "1"
