"""Tests of workers whose machine cannot prepare a scene or frame. Another worker prepares it, and the scene does not fail."""

from __future__ import annotations

import pytest

from protocol.contract import own_prepare_queue
from tests.service.api.test_environments import IMAGE
from tests.service.api.test_explain import explained
from tests.service.conftest import Service, until
from tests.service.viewer import look

FULL = "this machine cannot use its files (No space left on device: /tmp)"
LIMIT = "scene.obj cannot be read on this machine: its limit on address space (ulimit -v) of 1.0 GiB is too small. Raise it."


@pytest.mark.long
def test_unfit_machine_passes_scene_to_another_worker(service: Service) -> None:
    with service.worker(name="small") as small, service.worker(name="large", slots=1) as large:
        small.unfit = LIMIT
        scenes = [service.upload(b"v 0 0 0 # %d" % number) for number in range(4)]
        until(lambda: all(service.scene(id)["status"] == "ready" for id in scenes), "they are prepared")
        assert sorted(large.prepared) == sorted(scenes)


@pytest.mark.long
def test_error_lists_faults_of_all_machines(service: Service) -> None:
    with service.worker(name="alpha") as alpha, service.worker(name="beta", kind="another-kind") as beta:
        alpha.unfit, beta.unfit = LIMIT, FULL
        id = service.upload()
        until(lambda: service.scene(id)["status"] == "failed", "nobody is left")
        error = service.scene(id)["error"]
        assert error.startswith("No worker can prepare this scene. ")
        assert f"alpha: {LIMIT}" in error
        assert f"beta: {FULL}." in error
        assert "damaged" not in error
        assert (len(alpha.prepared), len(beta.prepared)) == (1, 1)
        alpha.unfit = None
        again = service.upload(b"v 0 0 1")
        until(lambda: service.scene(again)["status"] == "ready", "another scene is prepared")


def test_temporary_machine_fault_is_retried(service: Service) -> None:
    with service.worker(name="alpha") as alpha:
        alpha.unfit, alpha.passing = FULL, True
        id = service.upload()
        until(lambda: len(alpha.prepared) >= 3, "it is tried again")
        scene = service.scene(id)
        assert scene["status"] == "preparing"
        alpha.unfit = None
        until(lambda: service.scene(id)["status"] == "ready", "it is prepared")


@pytest.mark.long
def test_unfit_machine_passes_frames_to_another_worker(service: Service) -> None:
    with service.worker(name="alpha") as alpha, service.worker(name="beta") as beta:
        scene = service.ready_scene()
        alpha.unfit = FULL
        job = service.submit(scene, frames="0-5")
        service.wait_for(job, "finished")
        assert sorted(beta.frames) == [0, 1, 2, 3, 4, 5]
        beta.unfit = LIMIT
        job = service.submit(scene, frames="6-9")
        service.wait_for(job, "failed")
        error = service.job(job)["error"]
        assert "No worker can prepare this shot." in error
        assert f"alpha: {FULL}." in error and f"beta: {LIMIT}" in error


def test_worker_queue_name_includes_kind() -> None:
    assert own_prepare_queue("0.2.0-x", "alpha") == "rayfarm.prepare.0.2.0-x.of.alpha"


def test_unfit_machine_passes_artifact_to_another_worker(service: Service) -> None:
    """Checks that another worker makes an artifact if the machine of one worker cannot make it.

    The artifacts are denoised pictures, motion vectors, thumbnails of environments and explanations of pixels.
    """
    with service.worker(name="small", slots=1, denoises=True) as small:
        scene = service.ready_scene()
        job = service.submit(scene)
        service.wait_for(job, "finished")
        small.unfit = LIMIT
        frame = f"/api/jobs/{job}/frames/0"
        asked = (
            (f"{frame}/image.exr?denoise=true", "make the denoised picture"),
            (f"{frame}/image.exr?aov=motion", "make the motion vectors"),
            (f"/api/jobs/{job}/explain?x=5&y=7", "explain this pixel"),
        )
        for url, what in asked:
            answer = service.http.get(url)
            assert answer.status_code == 502, (url, answer.text)
            assert answer.json()["detail"] == f"No worker can {what}. small: {LIMIT}"
        answer = service.http.post("/api/environments", files={"file": ("window.hdr", IMAGE)})
        assert answer.status_code == 502, answer.text
        assert f"small: {LIMIT}" in answer.json()["detail"]
        with service.worker(name="large", slots=1, denoises=True) as large:
            large.on_explain = explained
            until(lambda: len(service.farm.engine.snapshot.roster.ready_reports()) == 2, "both are there")
            for url, _ in asked:
                for _ in range(3):  # either worker may be asked first
                    answer = service.http.get(url)
                    assert answer.status_code == 200, (url, answer.text)
            assert service.http.post("/api/environments", files={"file": ("window.hdr", IMAGE)}).status_code == 201
            assert large.denoised and large.vectors and large.shown and large.explained


def test_unfit_machine_passes_view_frame_to_another_worker(service: Service) -> None:
    with service.worker(name="small", slots=1) as small, service.worker(name="large", slots=1) as large:
        scene = service.ready_scene()
        until(lambda: len(service.farm.engine.snapshot.roster.ready_reports()) == 2, "both are there")
        small.unfit = LIMIT
        with look(service, scene) as viewer:
            for id in range(3):
                viewer.show(id, frame=id + 1, spp=2)
                viewer.wait(id, 2)
            assert large.frames == [1.0, 2.0, 3.0]
            large.unfit = FULL
            viewer.show(3, frame=7, spp=2)
            until(lambda: (viewer.read(), bool(viewer.errors))[1], "the error comes")
            sentence = viewer.errors[-1]["detail"]
    assert "No worker can prepare this frame." in sentence
    assert f"small: {LIMIT}" in sentence and f"large: {FULL}." in sentence
