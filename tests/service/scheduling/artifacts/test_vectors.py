"""Tests of motion vectors: a worker makes them once from the job's request, independently of the film.

Without a worker that can make them, a request gets an error.
"""

from __future__ import annotations

import io
import time
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from service.scheduling.artifacts import artifact_task
from tests.service.conftest import Service
from tests.service.peer_worker import PeerWorker
from tests.service.scheduling.artifacts.test_denoising import finished, problem


def layers(content: bytes, folder: Path) -> dict[str, np.ndarray]:
    (folder / "a.exr").write_bytes(content)
    picture = oiio.ImageBuf(str(folder / "a.exr"))
    found = picture.get_pixels(oiio.FLOAT)
    return {name: found[..., i] for i, name in enumerate(picture.spec().channelnames)}


@pytest.mark.long
def test_motion_vectors_are_exported_and_made_once(service: Service, worker: PeerWorker, tmp_path: Path) -> None:
    scene = service.ready_scene()
    job = service.submit(scene, frames="3-4", turntable=2.0, camera=0)
    service.wait_for(job, "finished")
    url = f"/api/jobs/{job}/frames/3/image"
    digest = service.http.get(f"/api/jobs/{job}/frames/3/digest").json()
    whole = service.http.get(f"{url}.exr?aov=motion,all")
    assert whole.status_code == 200, whole.text
    plain = layers(service.http.get(f"{url}.exr?aov=all").content, tmp_path)
    found = layers(whole.content, tmp_path)
    assert set(found) - set(plain) == {"Vector.X", "Vector.Y", "Vector.Z", "Vector.W"}
    for name, plane in plain.items():
        np.testing.assert_array_equal(found[name], plane)
    rows, columns = np.mgrid[0:48, 0:64]  # the peer's formula
    for name, values in {"X": columns, "Y": rows, "Z": 0 * rows + 6, "W": -columns}.items():
        np.testing.assert_array_equal(found[f"Vector.{name}"], values)
    alone = layers(service.http.get(f"{url}.exr?aov=motion").content, tmp_path)
    assert list(alone) == ["Vector.X", "Vector.Y", "Vector.Z", "Vector.W"]
    assert service.http.get(f"{url}.png?aov=motion").headers["content-type"] == "image/png"
    assert [(work.frame, work.scene, work.camera, work.turntable) for work in worker.vectors] == [(6, scene, 0, 2.0)]
    assert worker.vectors[0].auto == service.http.get(f"/api/scenes/{scene}").json()["cameras"][-1]["view"]
    answer = service.http.get(f"/api/jobs/{job}/frames.zip?aov=motion,depth")
    with zipfile.ZipFile(io.BytesIO(answer.content)) as files:
        inside = [layers(files.read(name), tmp_path) for name in sorted(files.namelist())]
    assert [int(each["Vector.Z"][0, 0]) for each in inside] == [6, 8]
    assert all("Depth.Z" in each for each in inside)
    assert len(worker.vectors) == 2
    assert service.http.get(f"/api/jobs/{job}/frames/3/digest").json() == digest


@pytest.mark.long
def test_impossible_motion_vectors_give_error(service: Service, worker: PeerWorker) -> None:
    job = finished(service)
    url = f"/api/jobs/{job}/frames/0/image"
    assert "whole picture" in problem(service.http.get(f"{url}.exr?aov=motion&width=32"), 422)
    assert "image.exr" in problem(service.http.get(f"{url}.hdr?aov=motion"), 422)

    def fail(job: str) -> None:
        raise ValueError("the file is gone")

    worker.on_vectors = fail
    assert "motion vectors could not be made: the file is gone." in problem(service.http.get(f"{url}.exr?aov=motion"), 502)


@pytest.mark.long
def test_older_workers_get_no_vector_requests(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    with service.worker(knows_vectors=False):
        job = finished(service)
        url = f"/api/jobs/{job}/frames/0/image.exr?aov=motion"
        assert "older release" in problem(service.http.get(url), 503)


@pytest.mark.long
def test_request_of_killed_worker_is_sent_again(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(artifact_task, "MAX_UNSEEN_POLLS", 2)
    job = finished(service)
    lost: list[str] = []

    def lose_the_first(job: str) -> bool:
        if lost:
            return False
        lost.append(job)
        worker.current = {"vectors": job, "frame": 0}
        worker.report()
        time.sleep(2.2)  # the service polls once per second
        worker.current = {}
        return True

    worker.on_vectors = lose_the_first
    assert service.http.get(f"/api/jobs/{job}/frames/0/image.exr?aov=motion", timeout=30).status_code == 200
    assert (lost, len(worker.vectors)) == ([job], 1)
