"""Tests of jobs of several frames, with a real Redis and the real protocol. The frames are independent of each other."""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from protocol.contract import RenderBatch
from renderer.frames import parse_frames
from service.scheduling.jobs.agenda import PILOT_SAMPLES, FrameOrder
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest

SMALL = {"width": 32, "height": 24, "tile_size": 16}


def submit_shot(service: Service, scene: str, frames: str, **request: Any) -> str:
    return service.submit(scene, **{**SMALL, "spp": 4, "frames": frames, **request})


def frames_of(service: Service, job: str) -> dict[float, dict[str, Any]]:
    listed = service.http.get(f"/api/jobs/{job}/frames").raise_for_status().json()
    return {frame["number"]: frame for frame in listed}


def digest(service: Service, job: str, frame: float) -> str:
    return str(service.http.get(f"/api/jobs/{job}/frames/{frame}/digest").raise_for_status().json()["digest"])


def expected(frame: float, spp: int = 4) -> str:
    return expected_digest(32, 24, spp, round(2000 * frame))


def frames_by_first_batch(batches: list[RenderBatch]) -> list[float]:
    """Returns the frame numbers of these batches, without duplicates, in the order of each frame's first batch."""
    return list(dict.fromkeys(batch.frame / 2 for batch in batches))


ORDERS = ("breadth-first",)
OTHER_ORDERS = [pytest.param(order, marks=pytest.mark.long) for order in ("noisiest-first", "in-turn", "every-nth", "centre-out")]


@pytest.mark.long
@pytest.mark.parametrize("order", [*ORDERS, *OTHER_ORDERS])
def test_frames_are_independent_of_order(service: Service, worker: PeerWorker, order: str) -> None:
    job = submit_shot(service, service.ready_scene(), "0-3,7.5", order=order)
    done = service.wait_for(job, "finished")
    assert done["shot"]["states"] == {"finished": 5}
    assert (done["shot"]["frames"], done["shot"]["count"], done["progress"]) == ("0-3,7.5", 5, 1.0)
    if order != "noisiest-first":  # that order spends all samples where the noise is
        assert done["samples"] == 5 * 32 * 24 * 4
        assert [digest(service, job, n) for n in (0, 1, 2, 3, 7.5)] == [expected(n) for n in (0, 1, 2, 3, 7.5)]
    assert sorted(worker.frames) == [0, 1, 2, 3, 7.5], "each is prepared once"
    assert {batch.frame: batch.settings.view.eye[0] for batch in worker.batches} == {0: 0, 2: 1, 4: 2, 6: 3, 15: 7.5}


@pytest.mark.long
def test_shot_in_two_jobs_has_same_digests(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    jobs = [submit_shot(service, scene, frames) for frames in ("0-4", "0-1", "2-4", "3")]
    for job in jobs:
        service.wait_for(job, "finished")
    one, first, second, third = jobs
    assert [digest(service, first, n) for n in (0, 1)] == [digest(service, one, n) for n in (0, 1)]
    assert [digest(service, second, n) for n in (2, 3, 4)] == [digest(service, one, n) for n in (2, 3, 4)]
    assert digest(service, third, 3) == digest(service, one, 3)
    still = service.submit(scene, **SMALL, spp=4, frame=3)
    service.wait_for(still, "finished")
    assert digest(service, still, 3) == digest(service, one, 3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("order", "sequence"),
    [
        pytest.param({"order": "in-turn"}, [0, 1, 2, 3, 4, 5, 6, 7, 8], marks=pytest.mark.long),
        ({"order": "every-nth", "every": 4}, [0, 4, 8, 2, 6, 1, 3, 5, 7]),
        pytest.param({"order": "centre-out"}, [4, 3, 5, 2, 6, 1, 7, 0, 8], marks=pytest.mark.long),
    ],
)
def test_frames_start_in_requested_order(
    service: Service, worker: PeerWorker, order: dict[str, Any], sequence: list[int]
) -> None:
    job = submit_shot(service, service.ready_scene(), "0-8", **order)
    service.wait_for(job, "finished")
    assert frames_by_first_batch(worker.batches) == sequence


@pytest.mark.long
def test_breadth_first_gives_each_frame_one_sample_first(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "0-5", order="breadth-first", spp=8)
    service.wait_for(job, "finished")
    levels = [batch.first for batch in worker.batches]
    assert levels == sorted(levels), "samples 0 of all, then 1, then 2 and 3, then 4 to 7"
    assert [digest(service, job, n) for n in range(6)] == [expected(n, 8) for n in range(6)]


@pytest.mark.long
def test_failed_frame_is_named_and_others_continue(service: Service, worker: PeerWorker) -> None:
    def missing(frame: float) -> None:
        if frame == 2:
            raise ValueError("smoke.0002.png: there is no such file.")

    worker.on_frame = missing
    job = submit_shot(service, service.ready_scene(), "0-4")
    done = service.wait_for(job, "finished")
    assert done["shot"]["states"] == {"finished": 4, "failed": 1}
    assert done["shot"]["failed"] == "2"
    assert done["message"] == "Finished without frame 2. Set the job to running to try again."
    frames = frames_of(service, job)
    assert (frames[2]["state"], frames[2]["error"]) == ("failed", "smoke.0002.png: there is no such file.")
    assert digest(service, job, 3) == expected(3)

    worker.on_frame = lambda frame: None
    service.patch(job, state="running")
    healed = service.wait_for(job, "finished")
    assert healed["shot"]["states"] == {"finished": 5}
    assert digest(service, job, 2) == expected(2)


@pytest.mark.long
def test_job_fails_if_every_frame_fails(service: Service, worker: PeerWorker) -> None:
    def missing(frame: float) -> None:
        raise ValueError("there is nothing to see.")

    worker.on_frame = missing
    job = submit_shot(service, service.ready_scene(), "0-2")
    assert "there is nothing to see." in service.wait_for(job, "failed")["error"]


@pytest.mark.long
def test_failing_batch_fails_only_its_frame(service: Service, worker: PeerWorker) -> None:
    def fails(batch: RenderBatch) -> None:
        if batch.frame == 2:
            raise ValueError("a fault of the scene")

    worker.on_batch = fails
    job = submit_shot(service, service.ready_scene(), "0-2")
    done = service.wait_for(job, "finished", 30)
    assert done["shot"]["failed"] == "1"
    error = frames_of(service, job)[1]["error"]
    assert "a fault of the scene" in error
    assert error.endswith("To see it again: rayfarm render scene.glb --frame=1")
    assert [digest(service, job, n) for n in (0, 2)] == [expected(n) for n in (0, 2)]


@pytest.mark.long
def test_shot_is_extended_and_frames_get_more_samples(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "0-2")
    service.wait_for(job, "finished")
    assert service.patch(job, extend="3-4")["state"] == "queued"
    assert service.wait_for(job, "finished")["shot"]["frames"] == "0-4"
    assert [digest(service, job, n) for n in range(5)] == [expected(n) for n in range(5)]
    service.patch(job, frames="1-2", spp=8)
    service.wait_for(job, "finished")
    assert [digest(service, job, n) for n in range(5)] == [expected(n, 8 if n in (1, 2) else 4) for n in range(5)]
    go = threading.Event()
    worker.on_batch = lambda batch: (go.wait(10), None)[1]
    service.patch(job, spp=8)
    assert [frame["progress"] for frame in frames_of(service, job).values()] == [0.5, 0.9999, 0.9999, 0.5, 0.5]
    go.set()
    assert service.wait_for(job, "finished")["samples"] == 5 * 32 * 24 * 8
    assert [digest(service, job, n) for n in range(5)] == [expected(n, 8) for n in range(5)]


@pytest.mark.long
def test_frames_are_rendered_again(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "0-3")
    service.wait_for(job, "finished")
    worker.batches.clear()
    worker.frames.clear()
    service.patch(job, again="1,3")
    service.wait_for(job, "finished")
    assert sorted(worker.frames) == [1, 3]
    assert {batch.frame for batch in worker.batches} == {2, 6}
    assert [digest(service, job, n) for n in range(4)] == [expected(n) for n in range(4)]


@pytest.mark.long
def test_prioritized_frame_is_rendered_first(service: Service, worker: PeerWorker) -> None:
    gate = threading.Event()
    worker.on_batch = lambda batch: gate.wait(10) and None
    job = submit_shot(service, service.ready_scene(), "0-40", spp=2)
    until(lambda: bool(worker.batches), "it begins")
    assert service.patch(job, first=33)["shot"]["first"] == 33
    gate.set()
    service.wait_for(job, "finished", 60)
    assert frames_by_first_batch(worker.batches).index(33) < 20


def blobs(data: Path) -> dict[str, bytes]:
    """Returns the stored blobs by name. Blobs that are deleted during the call are omitted."""
    found = {}
    for path in (data / "blobs").glob("??/*"):
        with contextlib.suppress(FileNotFoundError):
            found[path.name] = path.read_bytes()
    return found


@pytest.mark.long
def test_few_frames_are_prepared_ahead_and_then_deleted(service: Service, worker: PeerWorker) -> None:
    gate = threading.Event()
    worker.on_batch = lambda batch: gate.wait(20) and None
    worker.on_frame = lambda frame: b"frame %f" % frame + b"x" * 1000
    job = submit_shot(service, service.ready_scene(), "0-99", spp=1)
    until(lambda: bool(worker.batches), "it begins")
    gate.set()
    service.wait_for(job, "finished", 60)
    assert [digest(service, job, n) for n in (0, 50, 99)] == [expected(n, 1) for n in (0, 50, 99)]

    def left() -> int:
        return sum(b"frame" in content for content in blobs(service.options["data"]).values())

    until(lambda: left() == 0, "what was compiled for frames is gone", say=left)


@pytest.mark.long
def test_restarted_service_continues_shot(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = submit_shot(service, service.ready_scene(), "0-19", spp=8)
    until(lambda: service.job(job)["shot"]["states"].get("finished", 0) >= 3, "some frames are done")
    service.restart()
    done = service.wait_for(job, "finished", 60)
    assert done["shot"]["states"] == {"finished": 20}
    assert [digest(service, job, n) for n in range(20)] == [expected(n, 8) for n in range(20)]


@pytest.mark.long
def test_restart_between_rounds_starts_next_round(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that a service that stops between two rounds of the order `noisiest-first` starts the next one after its restart.

    When it stops, all frames have the samples of the round, so no further result could start the next round.
    """
    request = {"spp": 64, "order": "noisiest-first"}
    whole = submit_shot(service, service.ready_scene(), "0-3", **request)
    service.wait_for(whole, "finished", 40)
    with monkeypatch.context() as ended:
        ended.setattr(FrameOrder, "_plan_round", lambda agenda: None)
        job = submit_shot(service, service.ready_scene(), "0-3", **request)
        until(lambda: service.job(job)["samples"] == 4 * PILOT_SAMPLES * 32 * 24, "all frames have the first round's samples")
        service.restart()
        time.sleep(0.5)
        ended.undo()
        service.restart()
    service.wait_for(job, "finished", 40)
    assert [digest(service, job, n) for n in range(4)] == [digest(service, whole, n) for n in range(4)]


@pytest.mark.long
def test_worker_without_frame_support_gets_no_frames(service: Service) -> None:
    with service.worker(name="old", kind="old-kind", knows_frames=False) as old:
        job = submit_shot(service, service.ready_scene(), "0-1")
        until(lambda: "release" in (service.job(job)["message"] or ""), "it says what it waits for", say=lambda: service.job(job))
        assert not old.frames
        with service.worker(name="new", kind="new-kind"):
            service.wait_for(job, "finished")


@pytest.mark.long
def test_worker_without_motion_blur_gets_no_open_shutter_frames(service: Service) -> None:
    with service.worker(name="old", kind="old-kind", blurs=False) as old:
        scene = service.ready_scene()
        still, shot = (
            service.submit(scene, **SMALL, spp=4, shutter=0.5),
            submit_shot(service, scene, "3", shutter=0.5, shutter_keys=2),
        )
        until(lambda: "blur" in (service.job(shot)["message"] or ""), "it says what it waits for", say=lambda: service.job(shot))
        service.wait_for(submit_shot(service, scene, "1"), "finished")
        assert old.frames == [1]
        with service.worker(name="new", kind="new-kind") as new:
            service.wait_for(still, "finished")
            service.wait_for(shot, "finished")
            assert sorted(zip(new.frames, new.shutters, strict=True), key=str) == [
                (0, {"shutter": 0.5}),
                (3, {"shutter": 0.5, "shutter_keys": 2}),
            ]
            assert {tuple(view.eye[0] for view in b.settings.views) for b in new.batches} == {(-0.25, 0.25), (2.75, 3.25)}
        assert old.frames == [1]


def test_invalid_frame_requests_are_rejected(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    shot, still = submit_shot(service, scene, "0-2"), service.submit(scene)
    for job, change, says in (
        (shot, {"first": 7}, "the shot has no frame 7; it has 0-2"),
        (shot, {"again": "2-3"}, "the shot has no frame 3"),
        (shot, {"frames": "1", "spp": 1}, "samples per pixel already; samples can only be added"),
        (shot, {"extend": "9-1"}, "ends before it begins"),
        (still, {"extend": "1-2"}, "The job is a still"),
    ):
        answer = service.http.patch(f"/api/jobs/{job}", json=change)
        assert answer.status_code in (409, 422)
        assert says in answer.text
    refused = service.http.post("/api/jobs", json={"scene": scene, "frames": "0-9", "seconds": 5, "order": "in-turn"})
    assert "order-needs-goal" in refused.text


@pytest.mark.long
def test_frame_numbers_equal_request(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "10-14x2,0.5", spp=1)
    service.wait_for(job, "finished")
    assert sorted(parse_frames("10-14x2,0.5")) == list(frames_of(service, job)) == [0.5, 10, 12, 14]
    assert service.http.get(f"/api/jobs/{job}/frames/0.5/image.png").status_code == 200
    assert service.http.get(f"/api/jobs/{job}/frames/11/image.png").status_code == 404
    assert service.http.get(f"/api/jobs/{job}/frames/0.3/image.png").status_code == 422


@pytest.mark.long
def test_unanswered_frame_request_fails_eventually(service: Service, worker: PeerWorker) -> None:
    answer = worker.send
    worker.send = lambda event, sums=None: None if event.get("frame") == 2 and "info" in event else answer(event, sums)  # type: ignore[method-assign]
    job = submit_shot(service, service.ready_scene(), "0-2")
    done = service.wait_for(job, "finished", 60)
    assert done["shot"]["failed"] == "1"
    assert "lost three times" in frames_of(service, job)[1]["error"]


@pytest.mark.long
def test_time_limit_applies_to_whole_shot(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = submit_shot(service, service.ready_scene(), "0-9", spp=None, seconds=1.5)
    done = service.wait_for(job, "finished")
    assert done["shot"]["order"] == "breadth-first"
    frames = frames_of(service, job).values()
    least, most = min(frame["spp"] for frame in frames), max(frame["spp"] for frame in frames)
    assert least >= 1
    assert most <= 4 * least, "all have had their share"
    assert {frame["state"] for frame in frames} == {"finished"}


@pytest.mark.long
def test_noise_goal_ends_each_frame_separately(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "0-2", spp=None, noise=0.5)
    service.wait_for(job, "finished")
    assert [frame["spp"] for frame in frames_of(service, job).values()] == [32, 32, 32], "the first look is enough"
    assert all(0 < frame["noise"] < 0.5 for frame in frames_of(service, job).values())


@pytest.mark.long
def test_noisiest_first_spends_budget_on_noisy_frames(service: Service, worker: PeerWorker) -> None:
    job = submit_shot(service, service.ready_scene(), "0-3", spp=64, order="noisiest-first")
    done = service.wait_for(job, "finished", 40)
    assert 0.9 * 4 * 64 * 32 * 24 <= done["samples"] <= 4 * 64 * 32 * 24
    assert done["shot"]["noise"] > 0
    for number, frame in frames_of(service, job).items():
        assert digest(service, job, number) == expected(number, int(frame["spp"]))


@pytest.mark.long
def test_resumed_shot_keeps_worker_kind(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = submit_shot(service, service.ready_scene(), "5-20", spp=8)
    until(lambda: service.job(job)["shot"]["states"].get("finished", 0) >= 2, "some frames are done")
    cancelled = service.patch(job, state="cancelled")
    assert cancelled["shot"]["states"]["finished"] >= 2
    assert service.patch(job, state="running")["kind"] == "test-kind"
    service.wait_for(job, "finished")
    assert [digest(service, job, n) for n in range(5, 21)] == [expected(n, 8) for n in range(5, 21)]
