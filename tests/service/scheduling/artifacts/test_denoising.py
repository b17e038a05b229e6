"""Tests of denoised pictures: available at any time during rendering, made once, and separate from the raw pictures.

Without a worker that can denoise, a request gets an error.
"""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest

from protocol.contract import ROUGH_PREVIEW_GROWTH, DenoiseFrame
from renderer.image import rgbe9995
from service.errors import Conflict
from service.jobs.denoised import denoised_artifact
from service.jobs.lookup import find_film
from service.scheduling.artifacts import denoising, previews
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.artifacts import ArtifactTasks
from service.scheduling.artifacts.denoising import MAX_STORED_BYTES, DenoisedLights, Denoising
from service.scheduling.artifacts.kept_artifacts import KeptArtifacts
from service.scheduling.artifacts.previews import DenoisedPreviews
from service.scheduling.engine import Engine
from service.scheduling.jobs import measurements
from service.store.bands import bands
from service.store.models import Job
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker


def raw(service: Service, job: str, query: str = "") -> httpx.Response:
    return service.http.get(f"/api/jobs/{job}/frames/0/image.rgb9e5{query}")


def finished(service: Service) -> str:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    return job


@pytest.mark.long
def test_denoised_picture_is_made_by_worker_and_raw_one_is_unchanged(service: Service, worker: PeerWorker) -> None:
    job = finished(service)
    frame = f"/api/jobs/{job}/frames/0"
    assert service.http.get(frame).json()["denoised"] is False
    digest, before = service.digest(job), raw(service, job).content
    answer = raw(service, job, "?denoise=true")
    assert answer.status_code == 200, answer.text
    assert service.http.get(frame).json()["denoised"] is True
    assert service.http.get(f"/api/jobs/{job}").json()["frames"][0]["denoised"] is True
    assert answer.headers["x-samples"] == str(64 * 48 * 8)
    color = np.concatenate(list(bands(find_film(job, 0, service.farm), 0, ["color"])))
    expected = color / 2 + np.array([0, 0, 1], np.float32)  # the peer's formula; its albedo is black, its normals are +Z
    np.testing.assert_array_equal(np.frombuffer(answer.content, "<u4").reshape(48, 64), rgbe9995.pack(expected))
    for extension in ("png", "jpg", "exr", "hdr"):
        file = service.http.get(f"/api/jobs/{job}/frames/0/image.{extension}?denoise=true")
        assert file.status_code == 200
        assert "-denoised." in file.headers["content-disposition"]
    assert (service.digest(job), raw(service, job).content) == (digest, before)
    assert worker.denoised == [job], "made once, for whatever is asked of it"
    (guide,) = worker.guides
    assert guide is not None
    assert (guide.kind, guide.settings.width, guide.moment) == (worker.kind, 64, None)
    assert worker.http.get(f"/api/farm/blobs/{guide.compiled}").status_code == 200
    tagged = raw(service, job, "?denoise=true").headers["etag"]
    assert tagged != raw(service, job).headers["etag"]
    url = f"/api/jobs/{job}/frames/0/image.rgb9e5?denoise=true"
    assert service.http.get(url, headers={"If-None-Match": tagged}).status_code == 304


@pytest.mark.long
def test_last_picture_goes_before_previews(service: Service, worker: PeerWorker) -> None:
    """A request for the picture itself drops a preview that has not begun; clients of the preview receive the picture."""
    busy, job = finished(service), finished(service)
    begun, go = threading.Event(), threading.Event()
    worker.on_denoise = lambda _: (begun.set(), go.wait(20), None)[-1]
    waiting = service.farm.engine._artifact_tasks.previews._wanted
    with ThreadPoolExecutor(4) as pool:
        first = pool.submit(raw, service, busy, "?denoise=true&preview=true")
        assert begun.wait(20)
        preview = pool.submit(raw, service, job, "?denoise=true&preview=true")
        until(lambda: (job, 0) in waiting, "its preview is requested")
        picture = pool.submit(raw, service, job, "?denoise=true")
        until(lambda: (job, 0) not in waiting, "the preview is dropped")
        later = pool.submit(raw, service, job, "?denoise=true&preview=true")
        go.set()
        assert {each.result().status_code for each in (first, preview, picture, later)} == {200}
    assert preview.result().content == picture.result().content == later.result().content
    assert "x-preview" not in preview.result().headers
    assert worker.denoised == [busy, job], "a preview of the one, the picture of the other"
    assert worker.guides[0] is None and worker.guides[1] is not None


@pytest.mark.long
def test_scene_stores_how_long_denoising_takes(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = service.ready_scene()
    job = service.submit(scene)
    service.wait_for(job, "finished")
    assert service.scene(scene)["measured"]["denoise_s"] is None
    monkeypatch.setattr(measurements, "LEAST_DENOISED", 0)
    worker.on_denoise = lambda _: time.sleep(measurements.BEGIN_S + 0.2)
    raw(service, job, "?denoise=true&preview=true")
    begun = time.monotonic()
    raw(service, job, "?denoise=true")
    took = time.monotonic() - begun
    until(lambda: service.scene(scene)["measured"]["denoise_s"], "it is stored")
    assert 0.2 <= service.scene(scene)["measured"]["denoise_s"] * 64 * 48 <= took - measurements.BEGIN_S


@pytest.mark.long
def test_grown_film_is_denoised_again(service: Service, worker: PeerWorker) -> None:
    job = finished(service)
    first = raw(service, job, "?denoise=true")
    service.patch(job, spp=16)
    service.wait_for(job, "finished")
    second = raw(service, job, "?denoise=true")
    assert second.content != first.content
    assert second.headers["x-samples"] == str(64 * 48 * 16)
    assert len(worker.denoised) == 2
    blobs = [made.sha256 for made in service.farm.engine._artifact_tasks.denoising._made.values()]
    assert len(blobs) == 1, "the old one is gone"


@pytest.mark.long
def test_many_requests_share_one_denoising(service: Service, worker: PeerWorker) -> None:
    job = finished(service)
    go = threading.Event()
    worker.on_denoise = lambda job: (go.wait(20), None)[1]
    limits = httpx.Limits(max_connections=100)
    with ThreadPoolExecutor(60) as pool, httpx.Client(base_url=service.url, timeout=30, limits=limits) as http:
        # more than the service's threads
        readers = [pool.submit(http.get, f"/api/jobs/{job}/frames/0/image.rgb9e5?denoise=true") for _ in range(60)]
        until(lambda: job in {key[0] for key in service.farm.engine._artifact_tasks.denoising._wanted}, "it is asked for")
        time.sleep(0.3)
        begun = time.monotonic()
        assert raw(service, job).status_code == 200
        assert service.http.get("/api/jobs").status_code == 200
        assert time.monotonic() - begun < 3
        go.set()
        assert {reader.result().content for reader in readers} == {readers[0].result().content}
        assert {reader.result().status_code for reader in readers} == {200}
    assert worker.denoised == [job]


@pytest.mark.long
def test_slow_blob_store_delays_no_job(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    job = finished(service)
    raw(service, job, "?denoise=true")
    go = threading.Event()
    monkeypatch.setattr(service.farm.blobs, "exists", lambda sha256: go.wait(20))
    with ThreadPoolExecutor(1) as pool:
        reader = pool.submit(raw, service, job, "?denoise=true")
        time.sleep(0.3)  # the service looks it up in the store
        service.wait_for(service.submit(service.ready_scene(), seed=1), "finished")
        go.set()
        assert reader.result().status_code == 200


@pytest.mark.long
def test_slow_blob_store_at_result_delays_no_job(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    job = finished(service)
    asked, go = threading.Event(), threading.Event()
    size = service.farm.blobs.size
    monkeypatch.setattr(service.farm.blobs, "size", lambda sha256: asked.set() or (go.wait(20) and size(sha256)))
    with ThreadPoolExecutor(1) as pool:
        reader = pool.submit(raw, service, job, "?denoise=true")
        until(asked.is_set, "the worker has made it and the store is asked for it")
        service.wait_for(service.submit(service.ready_scene(), seed=1), "finished", timeout=10)
        assert not reader.done()
        go.set()
        assert reader.result().status_code == 200


@pytest.mark.long
def test_denoising_during_rendering(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=60)
    until(lambda: service.job(job)["samples"] > 0, "it has begun")
    answer = raw(service, job, "?denoise=true")
    assert answer.status_code == 200
    assert 0 < int(answer.headers["x-samples"]) < 64 * 48 * 60
    service.wait_for(job, "finished")


@pytest.mark.long
def test_preview_is_renewed_as_samples_grow(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=60)
    until(lambda: service.job(job)["samples"] > 0, "it has begun")
    pixels, made = 64 * 48, [0]
    while service.job(job)["state"] != "finished":
        answer = raw(service, job, "?denoise=true&preview=true")
        assert answer.status_code == 200, answer.text
        if int(answer.headers["x-samples"]) != made[-1]:
            made.append(int(answer.headers["x-samples"]))
    assert all(after >= ROUGH_PREVIEW_GROWTH * before for before, after in pairwise(made[1:-1])), made
    assert len(worker.denoised) <= 20
    last = raw(service, job, "?denoise=true&preview=true").headers
    assert (int(last["x-samples"]) > 30 * pixels, last["x-preview"]) == (True, "true")
    for query in ("", "&preview=true"):  # the picture itself is stored from then on
        found = raw(service, job, f"?denoise=true{query}").headers
        assert (found["x-samples"], "x-preview" in found) == (str(60 * pixels), False)
    assert set(worker.guides[:-1]) == {None} and worker.guides[-1] is not None
    tasks = service.farm.engine._artifact_tasks
    assert [each.samples for each in tasks.denoising._made.values()] == [60 * pixels], "a finished picture is no preview"
    assert not tasks.previews._made


def test_preview_made_after_the_picture_is_released() -> None:
    """A preview that a worker finishes after the picture itself leaves no blob, and clients get the picture."""
    picture, preview = ArtifactResult("a" * 64, "1", 8), ArtifactResult("b" * 64, "", 4)
    stored: list[ArtifactResult] = []
    released: list[tuple[str, int]] = []
    done: Future[ArtifactResult] = Future()
    done.set_result(preview)

    def request(*_: Any, **__: Any) -> Future[ArtifactResult]:
        if late:
            stored.append(picture)
        return done

    engine: Any = SimpleNamespace(
        denoised=lambda *_: stored[0] if stored else None,
        denoise_preview=request,
        preview_rest_s=lambda *_: 0.0,
        release_preview=lambda *key: released.append(key),
    )
    for late in (False, True):
        farm: Any = SimpleNamespace(engine=engine)
        made = denoised_artifact(Job(id="j", state="running"), 0, engine, farm, is_preview=True)
        assert asyncio.run(made) == (picture if late else replace(preview, is_preview=True))
        assert released == ([("j", 0)] if late else [])


@pytest.mark.parametrize("has_preview", [False, True])
def test_latest_preview_is_returned_without_a_wait(has_preview: bool) -> None:
    preview = ArtifactResult("b" * 64, "old", 4)
    engine: Any = SimpleNamespace(denoised=lambda *_: None, existing_preview=lambda *_: preview if has_preview else None)
    farm: Any = SimpleNamespace(engine=engine)
    made = denoised_artifact(Job(id="j", state="running"), 0, engine, farm, is_preview=True, waits=False)
    if has_preview:
        assert asyncio.run(made) == replace(preview, is_preview=True)
        return
    with pytest.raises(Conflict, match="no denoised preview"):
        asyncio.run(made)


@pytest.mark.parametrize(
    ("samples", "is_stored", "found"),
    [(64, True, 64), (63, True, 4), (64, False, 4), (3, True, None)],
)
def test_stored_picture_has_no_more_samples_than_the_film(samples: int, is_stored: bool, found: int | None) -> None:
    """A preview with more samples than the film is not used: its samples were lost, or removed as wrong."""
    preview, picture = (ArtifactResult(digit * 64, samples=made) for digit, made in (("a", 4), ("b", 64)))
    stored = {preview.sha256, picture.sha256} if is_stored else {preview.sha256}
    tasks = [Denoising.__new__(Denoising), DenoisedPreviews.__new__(DenoisedPreviews)]
    for task, made in zip(tasks, (picture, preview), strict=True):
        task._made = {("j", 0): made}
        task._blobs = SimpleNamespace(exists=stored.__contains__)  # type: ignore[assignment]
    engine = Engine.__new__(Engine)
    engine._artifact_tasks = SimpleNamespace(denoising=tasks[0], previews=tasks[1])  # type: ignore[assignment]
    film: Any = SimpleNamespace(samples=lambda frame: samples)
    existing = engine.existing_preview("j", 0, film)
    assert (existing and existing.samples) == found
    assert engine.has_denoised("j", 0, samples) is (found is not None)
    assert engine.existing_preview("j", 1, film) is None


@pytest.mark.long
def test_elapsed_time_of_a_job_includes_its_denoised_picture(service: Service, worker: PeerWorker) -> None:
    """With `denoise`, from the request for the picture on; the list of jobs shows the same."""
    scene = service.ready_scene()
    plain, job = service.submit(scene), service.submit(scene, seed=1, denoise=True)
    for id in (plain, job):
        service.wait_for(id, "finished")
        raw(service, id, "?denoise=true")
    until(lambda: service.job(job)["elapsed_s"] > service.job(job)["active_s"], "its time is known")
    listed = {each["id"]: each for each in service.http.get("/api/jobs").json()}
    assert listed[job]["elapsed_s"] == service.job(job)["elapsed_s"]
    assert listed[plain]["elapsed_s"] == listed[plain]["active_s"], "a denoised picture was not part of that job"


def test_time_of_a_denoised_picture_is_that_of_all_samples() -> None:
    task = Denoising.__new__(Denoising)
    task._lock = threading.Lock()
    task._made = {("j", 0): ArtifactResult("a" * 64, samples=64, waited_s=6.5)}
    pending = SimpleNamespace(begun=time.monotonic() - 3)
    task._wanted = {("j", 2): pending}  # type: ignore[dict-item]
    engine = Engine.__new__(Engine)
    engine._artifact_tasks = SimpleNamespace(denoising=task)  # type: ignore[assignment]
    assert engine.denoising_s("j", 0, 64) == 6.5
    assert engine.denoising_s("j", 0, 65) == 0, "more samples have come"
    assert 3 <= engine.denoising_s("j", 2, 64) < 60, "it is being made"


def test_request_waits_for_the_next_preview() -> None:
    """A page would otherwise receive the previous preview, and request the next one too late."""
    rests = [0.05, previews.MOST_SECONDS]
    waited: list[float] = []
    done: Future[ArtifactResult] = Future()
    done.set_result(ArtifactResult("b" * 64, "", 4))

    def request(*_: Any, **__: Any) -> Future[ArtifactResult]:
        waited.append(time.monotonic() - begun)
        return done

    engine: Any = SimpleNamespace(denoised=lambda *_: None, denoise_preview=request, preview_rest_s=lambda *_: rests.pop(0))
    farm: Any = SimpleNamespace(engine=engine)
    for state in ("running", "running", "finished"):
        begun = time.monotonic()
        asyncio.run(denoised_artifact(Job(id="j", state=state), 0, engine, farm, is_preview=True))
    assert waited[0] >= 0.05
    assert waited[1] < 5, "it rests for long: the previous one is returned"
    assert not rests, "the last one of a job does not wait"


def test_previews_take_a_twentieth_of_the_slots_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(previews, "time", SimpleNamespace(monotonic=lambda: now[0]))
    task = DenoisedPreviews.__new__(DenoisedPreviews)
    monkeypatch.setattr(task, "_able_workers", lambda: [SimpleNamespace(slots=2), SimpleNamespace(slots=8)])
    made = ArtifactResult("0" * 64, "v", samples=1000, seconds=1.5)
    request = DenoiseFrame("", "j", 0, 5, 3, is_preview=True)
    task._record_made(made, request)
    for after, samples, is_recent in (
        (0.0, 1999, True),
        (1.45, 5000, True),  # doubled, but the farm rests: 1.5 s of one slot are a twentieth of 3 s of ten slots
        (1.55, 1999, True),
        (1.55, 2000, False),
        (0.0, 999, False),  # the film was lost, and begun again
    ):
        now[0] = 100.0 + after
        assert task._is_recent(made, samples, 15) is is_recent, (after, samples)
    now[0] = 100.0
    task._record_made(made, replace(request, width=50))
    assert not task._is_recent(made, 1250, 150), "of few samples per pixel: one of ten slots is less than a third"
    monkeypatch.setattr(task, "_able_workers", lambda: [SimpleNamespace(slots=2)])
    task._record_made(made, replace(request, width=50))
    task._made = {("j", 0): made}
    for after, is_recent, rest in ((0.7, True, 0.05), (0.8, False, 0.0)):  # 1.5 s are a third of 2.25 s of two slots
        now[0] = 100.0 + after
        assert task._is_recent(made, 1250, 150) is is_recent, after
        assert task._is_recent(made, 1249, 150) is True, after
        assert task.rest_s("j", 0, 1250, 150) == pytest.approx(rest), after
        assert task.rest_s("j", 0, 1249, 150) == 0, "none is due"
    now[0] = 100.0
    assert task._is_recent(made, 3999, 150) is True
    assert task._is_recent(made, 4000, 150) is False, "at 1, 4, 16 and 64 samples without a rest"


def problem(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    return str(answer.json()["detail"])


@pytest.mark.long
def test_missing_denoiser_gives_error(service: Service) -> None:
    with service.worker():
        job = finished(service)
        assert service.http.get("/api/info").json()["denoise"] is True
    until(lambda: not service.farm.engine.snapshot.roster.reports, "the worker has left")
    assert "none is ready" in problem(raw(service, job, "?denoise=true"), 503)
    with service.worker(denoises=False):
        until(lambda: bool(service.farm.engine.snapshot.roster.reports), "another has come")
        assert "pip install" in problem(raw(service, job, "?denoise=true"), 503)
        assert service.http.get("/api/info").json()["denoise"] is False
        assert [worker["denoises"] for worker in service.http.get("/api/workers").json()] == [False]


@pytest.mark.long
def test_worker_error_is_reported_and_next_request_retries(service: Service, worker: PeerWorker) -> None:
    job = finished(service)

    def fail(job: str) -> None:
        raise ValueError("the library has no memory")

    worker.on_denoise = fail
    assert "has no memory." in problem(raw(service, job, "?denoise=true"), 502)
    worker.on_denoise = lambda job: None
    assert raw(service, job, "?denoise=true").status_code == 200


@pytest.mark.long
def test_timeout_is_reported(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Denoising, "_patience_s", 0.5)
    monkeypatch.setattr(denoising, "_GUIDE_S", 0.0)
    job = finished(service)
    worker.on_denoise = lambda job: time.sleep(4)
    assert "in time" in problem(raw(service, job, "?denoise=true"), 504)


@pytest.mark.long
def test_denoising_job_without_samples_or_deleted(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    worker.on_batch = lambda batch: False
    job = service.submit(scene)
    assert "no samples yet" in problem(raw(service, job, "?denoise=true"), 409)
    service.patch(job, state="cancelled")
    worker.on_batch = lambda batch: None
    job = finished(service)
    assert "leave aov out" in problem(raw(service, job, "?denoise=true&aov=normal"), 422)
    assert "add denoise=true" in problem(raw(service, job, "?in_shot=true"), 422)
    worker.on_denoise = lambda job: time.sleep(1)
    with ThreadPoolExecutor(1) as pool:
        reader = pool.submit(raw, service, job, "?denoise=true")
        until(lambda: bool(service.farm.engine._artifact_tasks.denoising._wanted), "it is asked for")
        service.http.delete(f"/api/jobs/{job}").raise_for_status()
        assert "deleted" in problem(reader.result(), 404)


@pytest.mark.long
def test_film_means_are_for_workers_only(service: Service, worker: PeerWorker) -> None:
    job = finished(service)
    problem(service.http.get(f"/api/farm/films/{job}/0"), 401)
    means = worker.http.get(f"/api/farm/films/{job}/0")
    assert len(means.content) == 3 * 48 * 64 * 3 * 4
    assert worker.http.get(f"/api/farm/films/{job}/1").status_code == 404
    until(lambda: not list((service.options["data"] / "tmp").glob("means-*")), "the file that was sent is gone")


@pytest.mark.long
def test_frame_of_a_shot_is_denoised_with_its_neighbours(service: Service, worker: PeerWorker) -> None:
    """A frame is averaged with up to two finished neighbours on each side, and with none beyond a missing frame."""
    job = service.submit(service.ready_scene(), frames="3-6,8", turntable=2.0, camera=0)
    service.wait_for(job, "finished")

    def words(frame: int, query: str = "&in_shot=true") -> np.ndarray:
        answer = service.http.get(f"/api/jobs/{job}/frames/{frame}/image.rgb9e5?denoise=true{query}")
        assert answer.status_code == 200, answer.text
        assert answer.headers["x-samples"] == str(64 * 48 * 8)
        return np.frombuffer(answer.content, "<u4").reshape(48, 64)

    film = find_film(job, 3, service.farm)
    colors = {frame: np.concatenate(list(bands(film, 2 * frame, ["color"]))) for frame in (3, 4, 5, 6, 8)}
    for frame, around in ((4, (3, 4, 5, 6)), (6, (4, 5, 6))):
        expected = np.mean([colors[each] for each in around], axis=0, dtype=np.float32)
        found = rgbe9995.unpack(words(frame))
        np.testing.assert_allclose(found, expected, rtol=0.01, atol=0.01)
        assert [key for key, _ in worker.denoised_in_shots[-1]] == [2 * each for each in around]
    assert len({motion for _, motion in worker.denoised_in_shots[0]}) == 4
    before = len(worker.denoised_in_shots)
    words(6)
    assert len(worker.denoised_in_shots) == before, "made once"
    assert not worker.denoised
    alone = words(8)
    assert worker.denoised == [job], "a frame without neighbours is denoised alone"
    (guide,) = worker.guides
    assert guide is not None and guide.moment is not None
    assert (guide.moment.frames, guide.moment.turntable) == ([16], 2.0)
    assert np.array_equal(alone, words(8, ""))
    assert words(3).any() and len(worker.denoised_in_shots) == before + 1

    def fail(_: str) -> None:
        raise ValueError("the file is gone")

    other = service.submit(service.ready_scene(), frames="1-2", turntable=2.0, camera=0)
    service.wait_for(other, "finished")
    worker.on_vectors = fail
    assert service.http.get(f"/api/jobs/{other}/frames/1/image.png?denoise=true&in_shot=true").status_code == 200
    assert worker.denoised[-1] == other, "without motion vectors it is denoised alone"


def test_previews_leave_a_slot_that_the_picture_of_another_job_may_take(tmp_path: Path) -> None:
    """Two clients would otherwise occupy both slots of a machine, and live views would stop."""
    ready, sent = ["k"], list[tuple[str, bool]]()
    report: Any = SimpleNamespace(denoises=True, slots=2, kind="k")
    roster = SimpleNamespace(ready_reports=lambda: [report][: len(ready)], denoising_kind=lambda: ready[0] if ready else None)
    workers: Any = SimpleNamespace(roster=roster)
    dispatcher: Any = SimpleNamespace(send_denoise=lambda request, _: sent.append((request.job, request.is_preview)))
    settings: Any = SimpleNamespace(data=tmp_path, prepare_deadline=1.0, frame_scenes_bytes=0)
    nothing: Any = None
    tasks = ArtifactTasks(settings, dispatcher, workers, nothing, nothing)
    preview, picture = DenoiseFrame("", "a", 0, 4, 4, is_preview=True), DenoiseFrame("", "b", 0, 4, 4)
    tasks.previews.request(preview)
    tasks.fill_artifacts()
    waiting = [
        tasks.previews.request(replace(preview, job="c")),
        tasks.denoised_lights.request(replace(preview, job="d")),
        tasks.denoising.request(picture),
    ]
    tasks.fill_artifacts()
    assert sent == [("a", True), ("b", False)]
    tasks.discard_job("a")
    tasks.fill_artifacts()
    assert len(sent) == 2, "the picture still takes the slot"
    ready.clear()
    tasks.fill_artifacts()
    assert [each.done() for each in waiting] == [True, True, False], "requests that wait fail with their workers"
    tasks.close()


def test_false_duration_of_a_preview_does_not_stop_renewals() -> None:
    workers = SimpleNamespace(roster=SimpleNamespace(ready_reports=list))
    made = DenoisedPreviews(None, workers, None, None)  # type: ignore[arg-type]
    made._record_made(ArtifactResult("", samples=1 << 20, seconds=1e308), DenoiseFrame("", "j", 0, 4, 4))
    assert made._rests_until - time.monotonic() <= previews.MOST_SECONDS / previews.SHARE
    made.close()


def test_stored_pictures_are_known_after_a_restart(tmp_path: Path) -> None:
    kept = KeptArtifacts(tmp_path / "denoised.json")
    assert kept.load() == {}
    made = {("job", 0): ArtifactResult("a" * 64, "version", 9, 1.5, 6.5), ("shot", 14): ArtifactResult("b" * 64, "a+b", 3)}
    kept.save(made)
    assert KeptArtifacts(tmp_path / "denoised.json").load() == made
    (tmp_path / "denoised.json").write_text(f'[["job", 0, "{"a" * 64}", "version", 9, 1.5]]')
    earlier = {("job", 0): ArtifactResult("a" * 64, "version", 9, 1.5)}
    assert kept.load() == earlier, "of a release that did not store how long a request waited"
    (tmp_path / "denoised.json").write_text('[["job", 0, "../secret", "", 1, 0]]')
    assert kept.load() == {}, "no hash"
    (tmp_path / "denoised.json").write_text("[[1]]")
    assert kept.load() == {}, "damaged"
    (tmp_path / "denoised.json").write_text(f'[["job", Infinity, "{"a" * 64}", "", 1, 0]]')
    assert kept.load() == {}, "no frame"


def test_stored_pictures_of_deleted_jobs_are_forgotten(tmp_path: Path) -> None:
    kept = KeptArtifacts(tmp_path / "denoised.json")
    kept.save({("job", 0): ArtifactResult("a" * 64), ("deleted", 0): ArtifactResult("b" * 64)})
    task = Denoising(None, None, None, None)  # type: ignore[arg-type]
    task.keep_in(kept)
    assert task.blobs_of({"job"}) == {"a" * 64}
    task._save_made()
    assert set(kept.load()) == {("job", 0)}
    task.close()


def test_light_groups_of_many_frames_take_bounded_space() -> None:
    """A client that mixes frame after frame of a shot would fill the disk, since each frame has up to 512 MiB."""
    released: list[str] = []
    events: Any = SimpleNamespace(publish=lambda event: released.extend(event.references))
    task = DenoisedLights(None, None, None, events)  # type: ignore[arg-type]
    frame = DenoiseFrame("", "job", 0, 2048, 1024, lights=("key", "fill"))
    size, sha256 = 3 * 4 * 2048 * 1024 * 2, "{:064x}".format
    most = MAX_STORED_BYTES // size
    for number in [*range(most), 1, *range(most, most + 3)]:
        made = ArtifactResult(sha256(number))
        with task._lock:
            task._made["job", number] = made
            task._record_made(made, replace(frame, frame=number))
    until(lambda: len(released) == 3, "the first are deleted")
    assert released == [sha256(0), sha256(2), sha256(3)], "one that was made again is not the oldest"
    assert len(task._made) == most
    task.close()
