"""Tests of path guides on a farm: each frame's is trained once, before its batches, and slots do other work meanwhile."""

from __future__ import annotations

import hashlib
import threading
import time
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import TrainPathGuide, WorkerReport
from renderer.settings import RenderSettings, View
from service.errors import Unavailable
from service.events import BlobsReleased, Events
from service.http.redaction import RESOURCE_FIELDS
from service.scheduling.artifacts import artifact_task
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.artifact_task import ArtifactTask
from service.scheduling.artifacts.path_guides import PathGuides
from service.scheduling.fleet.workers import WorkerSnapshot
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, guide_of


def sha256_of(job: str, frame: int) -> str:
    return hashlib.sha256(guide_of(job, frame)).hexdigest()


def report(name: str, has_cards: bool = False) -> WorkerReport:
    """Returns the report of a worker; one with cards is beside a worker with cores."""
    return WorkerReport(
        *(name, "host", 1, 1, "CPU", "kind", "ready", 0.0),
        trains_guides=True,
        views=not has_cards,
        has_card_queue=has_cards,
    )


def snapshot(*reports: WorkerReport) -> WorkerSnapshot:
    return WorkerSnapshot({each.name: each for each in reports})


def guides_of(workers: Any, events: Events) -> tuple[PathGuides, list[TrainPathGuide]]:
    """Returns (the requests for guides of a farm with these workers, the list of those that are sent)."""
    sent: list[TrainPathGuide] = []
    dispatcher: Any = SimpleNamespace(send_path_guide=lambda work, queue: sent.append(work))
    blobs: Any = SimpleNamespace(size=lambda sha256: 100)
    return PathGuides(dispatcher, workers, blobs, events), sent


def request(frame: int) -> TrainPathGuide:
    settings = RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0)), guiding="auto")
    return TrainPathGuide("", "job", frame, "kind", "c" * 64, settings)


def test_guide_is_trained_once_and_slots_do_other_work_meanwhile(service: Service, worker: PeerWorker) -> None:
    """Two machines. While one trains, the other renders a job without a guide, and no batch of the guided one."""
    may_end, began = threading.Event(), threading.Event()

    def hold(work: TrainPathGuide) -> None:
        began.set()
        assert may_end.wait(20)

    scene = service.ready_scene()
    with service.worker(name="second") as second:
        both = (worker, second)
        for each in both:
            each.on_path_guide = hold
        guided = service.submit(scene, guiding="on")
        assert began.wait(20)
        other = service.submit(scene)
        service.wait_for(other, "finished")
        assert not [batch for each in both for batch in each.batches if batch.job == guided]
        may_end.set()
        service.wait_for(guided, "finished")
    ((trained,),) = [[work for each in both for work in each.path_guides]]
    assert (trained.job, trained.frame, trained.kind, trained.settings.guiding) == (guided, 0, "test-kind", "on")
    batches = [batch for each in both for batch in each.batches]
    assert {batch.guide for batch in batches if batch.job == guided} == {sha256_of(guided, 0)}
    assert {batch.guide for batch in batches if batch.job == other} == {""}
    assert {batch.compiled for batch in batches if batch.job == guided} == {trained.compiled}
    assert service.digest(guided) == service.digest(other), "a peer's samples do not depend on the guide"


def test_frames_of_a_shot_have_guides_of_their_own_which_are_released(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), frames="1-5", turntable=2.0, guiding="auto")
    service.wait_for(job, "finished")
    frames = [2 * number for number in range(1, 6)]
    assert sorted(work.frame for work in worker.path_guides) == frames
    assert len({work.settings.view for work in worker.path_guides}) == 5
    for batch in worker.batches:
        assert batch.guide == sha256_of(job, batch.frame)
    blobs = service.farm.blobs
    until(lambda: not any(blobs.exists(sha256_of(job, frame)) for frame in frames), "the guides are deleted")


def test_guides_of_many_jobs_do_not_delay_an_urgent_one(service: Service, worker: PeerWorker) -> None:
    """Only one request a slot is open, so that the guide of a job of higher priority is the next to be trained."""
    may_end, scene = threading.Event(), service.ready_scene()
    worker.on_path_guide = lambda work: not may_end.wait(20)
    jobs = [service.submit(scene, guiding="on") for _ in range(4)]
    for job in jobs:
        service.wait_for(job, "running")
    urgent = service.submit(scene, guiding="on", priority=5)
    service.wait_for(urgent, "running")
    may_end.set()
    for job in (*jobs, urgent):
        service.wait_for(job, "finished")
    trained = [work.job for work in worker.path_guides]
    assert trained.index(urgent) == worker.slots
    assert sorted(trained) == sorted([*jobs, urgent])


@pytest.mark.long
def test_worker_kinds_do_not_share_guides(service: Service, worker: PeerWorker) -> None:
    """A larger group of workers of another kind joins while the first guide is trained: it trains its own."""
    may_end, began = threading.Event(), threading.Event()
    worker.on_path_guide = lambda work: bool(began.set()) or not may_end.wait(20)
    job = service.submit(service.ready_scene(), frames="1-2", turntable=2.0, guiding="on")
    assert began.wait(20)
    with service.worker(name="other", kind="other-kind", slots=20) as other:
        until(lambda: len(other.frames) == 2, "the frames are prepared for this kind")
        may_end.set()
        service.wait_for(job, "finished")
    assert sorted(work.frame for work in other.path_guides) == [2, 4]


def test_guides_that_cannot_be_trained_are_left_to_the_slots(service: Service, worker: PeerWorker) -> None:
    def fail(work: TrainPathGuide) -> None:
        raise ValueError("there is no disk")

    worker.on_path_guide = fail
    job = service.submit(service.ready_scene(), guiding="on")
    service.wait_for(job, "finished")
    assert {batch.guide for batch in worker.batches} == {""}
    assert "The path guide could not be made: there is no disk." in service.http.get(f"/api/jobs/{job}/log").text


def test_older_workers_train_their_guides_themselves(service: Service) -> None:
    with service.worker(trains_guides=False) as worker:
        service.wait_for(service.submit(service.ready_scene(), guiding="on"), "finished")
        assert worker.path_guides == [] and {batch.guide for batch in worker.batches} == {""}


@pytest.mark.long
def test_guide_of_killed_worker_is_trained_again(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(artifact_task, "MAX_UNSEEN_POLLS", 2)
    lost: list[str] = []

    def lose_the_first(work: TrainPathGuide) -> bool:
        if lost:
            return False
        lost.append(work.job)
        worker.current = {"path_guide": work.job, "frame": 0}
        worker.report()
        time.sleep(2.2)  # the service polls once per second
        worker.current = {}
        return True

    worker.on_path_guide = lose_the_first
    job = service.submit(service.ready_scene(), guiding="on")
    service.wait_for(job, "finished", 30)
    assert (lost, len(worker.path_guides)) == ([job], 1)
    assert {batch.guide for batch in worker.batches} == {sha256_of(job, 0)}


@pytest.mark.long
def test_restarted_service_has_guides_trained_again(service: Service, worker: PeerWorker) -> None:
    """A service that is restarted between a frame's batches loses none of them; the guide is the same."""
    job = service.submit(service.ready_scene(), guiding="on", spp=64)
    until(lambda: len(worker.batches) >= 2, "it is being rendered")
    service.restart()
    worker.http.base_url = service.url  # which has another port
    service.wait_for(job, "finished", 30)
    assert {batch.guide for batch in worker.batches} == {sha256_of(job, 0)}
    plain = service.submit(service.ready_scene(), spp=64)
    service.wait_for(plain, "finished", 30)
    assert service.digest(job) == service.digest(plain)


def test_equal_guides_are_deleted_with_the_last_of_their_frames() -> None:
    """Such as those of two jobs with the same settings, or of all frames whose paths follow no guide."""
    events, released = Events(), list[BlobsReleased]()
    events.subscribe(BlobsReleased, released.append)
    guides, sent = guides_of(SimpleNamespace(roster=snapshot(report("cores"))), events)
    futures = [guides.request(request(frame)) for frame in (0, 1)]
    guides.dispatch_work()
    for work, future in zip(sent, futures, strict=True):
        guides.handle_answer(work.work, ArtifactResult("a" * 64))
        assert future.result(10).sha256 == "a" * 64
    guides.release("job", 0)
    guides._aside.submit(int).result(10)  # after the deletion, in the same thread
    assert released == []
    guides.release("job", 1)
    guides._aside.shutdown()
    assert released == [BlobsReleased(Counter(["a" * 64]))]
    events.close()


def test_slots_with_cards_train_their_guides_if_no_core_reads_requests() -> None:
    cores, cards = report("attic"), report("attic-gpu", has_cards=True)
    workers, events = SimpleNamespace(roster=snapshot(cards)), Events()
    guides, sent = guides_of(workers, events)
    with pytest.raises(Unavailable, match="No ready worker can train path guides"):
        guides.request(request(0))
    workers.roster = snapshot(cores, cards)
    begun, waiting = guides.request(request(0)), guides.request(request(1))
    guides.dispatch_work()
    doing = [{"path_guide": "job", "frame": 0}]
    for state in (cores, replace(cores, current=doing), replace(cores, current=doing, state="paused")):
        assert not waiting.done()
        workers.roster = snapshot(state, cards)
        guides.release_lost()
    with pytest.raises(Unavailable):
        waiting.result(0)
    guides.handle_answer(sent[0].work, ArtifactResult("a" * 64))
    assert begun.result(10).sha256 == "a" * 64, "the paused worker ends what it has begun"
    guides.close()
    events.close()


def test_restarting_workers_keep_their_requests() -> None:
    workers, events = SimpleNamespace(roster=snapshot(report("attic"))), Events()
    guides, _ = guides_of(workers, events)
    waiting = guides.request(request(0))
    guides.dispatch_work()
    workers.roster = snapshot()
    guides.release_lost()
    assert not waiting.done()
    guides.close()
    events.close()


def test_slots_do_not_show_hidden_jobs_by_their_artifacts() -> None:
    assert {each._doing for each in ArtifactTask.__subclasses__()} <= RESOURCE_FIELDS.keys()
