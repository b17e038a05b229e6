"""Tests of jobs while batches, workers, Redis, the service or a film are lost. Jobs take longer, but have the same pictures."""

from __future__ import annotations

import signal
import threading
import time

import pytest
import redis

from protocol.contract import RESULTS, RenderBatch, Result
from protocol.sums import pack_sums
from service.scheduling.incoming.results import Entry
from tests.helpers import running_redis
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest, expected_sums


def test_restart_continues_from_film(service: Service) -> None:
    enough, over = threading.Event(), threading.Event()
    with service.worker() as worker:
        worker.on_batch = lambda batch: (time.sleep(0.03), enough.is_set() and over.wait(10), None)[2]
        job = service.submit(service.ready_scene(), spp=40)
        until(lambda: service.job(job)["progress"] > 0.2, "the job is under way")
        enough.set()
        service.stop()
        over.set()
    service.start()
    with service.worker() as worker:
        go = threading.Event()
        worker.on_batch = lambda batch: (go.wait(10), None)[1]
        until(lambda: worker.redis.xlen(RESULTS) == 0 and bool(worker.batches), "what arrived meanwhile is taken in")
        before = service.job(job)["samples"]
        assert 0 < before < 64 * 48 * 40
        go.set()
        service.wait_for(job, "finished")
        after = service.job(job)["samples"]
    assert service.digest(job) == expected_digest(spp=40)
    rendered = sum(b.count * b.tile.w * b.tile.h for b in worker.batches)
    assert rendered <= after - before + 4 * 30 * 256, "what the film has is not rendered again, but for what was in hand"


def test_emptied_redis_only_delays_jobs(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=30)
    until(lambda: service.job(job)["progress"] > 0.2, "the job is under way")
    with redis.Redis.from_url(service.options["redis_url"]) as client:
        client.flushall()
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)


@pytest.mark.long
def test_unreachable_redis_only_delays_jobs(service: Service, worker: PeerWorker, redis_server: running_redis) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=30)
    until(lambda: service.job(job)["progress"] > 0.2, "the job is under way")
    redis_server.stop()
    until(lambda: service.http.get("/readyz").status_code == 503, "the service says that Redis is away")
    assert "Redis" in service.http.get("/readyz").json()["detail"]
    assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 200
    redis_server.start()
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)


@pytest.mark.long
def test_bad_samples_are_listed_with_command(service: Service, worker: PeerWorker) -> None:
    def with_bad(batch: RenderBatch) -> bool:
        sums = expected_sums(batch.tile, batch.first, batch.count, 0)
        bad = [[batch.tile.x, batch.tile.y, batch.first]] if batch.first == 0 else []
        event = {"type": "batch", **worker._about(batch), "seconds": 0.01, "bad": bad, "bad_count": len(bad)}
        worker.send(event, pack_sums(sums))
        return False

    worker.on_batch = with_bad
    job = service.submit(service.ready_scene(), sampler="independent")
    finished = service.wait_for(job, "finished")
    assert finished["bad_samples"] == 12
    bad = finished["frames"][0]["bad"]
    assert {(b["x"], b["y"], b["sample"]) for b in bad} == {(x, y, 0) for x in (0, 16, 32, 48) for y in (0, 16, 32)}
    assert bad[0]["reproduce"].endswith(f"--pixel={bad[0]['x']},{bad[0]['y']} --sample=0")
    assert "--sampler=independent" in bad[0]["reproduce"]
    assert "--no-floor" in bad[0]["reproduce"], "this upload asked for none, and the command adds one to scenes without light"


@pytest.mark.long
def test_failing_worker_is_quarantined_until_resumed(service: Service) -> None:
    with service.worker(name="good") as good, service.worker(name="bad") as bad:

        def fail(batch: RenderBatch) -> None:
            raise ValueError("the disk is full")

        bad.on_batch = fail
        good.on_batch = lambda batch: time.sleep(0.05)
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both are seen")
        job = service.submit(service.ready_scene(), spp=40)

        def state_of(name: str) -> dict[str, str]:
            return next(w for w in service.http.get("/api/workers").json() if w["name"] == name)

        until(lambda: state_of("bad")["state"] == "paused", "it is set aside")
        assert "of its batches failed while others rendered theirs. Check its log, then resume it" in state_of("bad")["message"]
        assert (state_of("good")["state"], state_of("good")["message"]) == ("ready", None)
        service.wait_for(job, "finished")
        assert service.digest(job) == expected_digest(spp=40)
        tried = len(bad.batches)
        again = service.submit(service.ready_scene(), seed=1)
        service.wait_for(again, "finished")
        assert len(bad.batches) == tried, "it is given nothing"
        bad.on_batch = lambda batch: None
        good.on_batch = lambda batch: time.sleep(0.2)
        assert service.http.patch("/api/workers/bad", json={"state": "running"}).json()["state"] == "ready"
        service.wait_for(service.submit(service.ready_scene(), seed=2), "finished")
        assert len(bad.batches) > tried


def test_lost_batch_is_dispatched_again(service: Service, worker: PeerWorker) -> None:
    lost: list[RenderBatch] = []

    def lose_two(batch: RenderBatch) -> bool | None:
        if len(lost) < 2:
            lost.append(batch)
            return False
        return None

    worker.on_batch = lose_two
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()
    assert len({b.batch for b in worker.batches}) == len(worker.batches), "every handing out has an id of its own"


@pytest.mark.long
def test_answer_with_foreign_batch_delays_no_job(service: Service, worker: PeerWorker) -> None:
    wrong: list[RenderBatch] = []

    def mix_up(batch: RenderBatch) -> bool | None:
        if wrong:
            return None
        wrong.append(batch)
        worker.send({"type": "batch", **worker._about(batch), "job": "another", "seconds": 0.1}, b"sums")
        return False

    worker.on_batch = mix_up
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_unread_results_are_not_lost(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    job = service.submit(service.ready_scene(), spp=20, tile_size=32)
    results = service.farm.engine._results
    read = results.read
    monkeypatch.setattr(results, "read", lambda block_ms: time.sleep(0.1) or [])
    until(lambda: len(worker.batches) >= 4, "the window is full of what is rendered and not read")
    out = len(worker.batches)
    time.sleep(4.5)  # longer than the three polls after which it counted as lost
    assert len(worker.batches) == out, "nothing is rendered twice, and nothing more is handed out"
    monkeypatch.setattr(results, "read", read)
    service.wait_for(job, "finished")
    assert service.farm.engine.snapshot.counts["lost"] == 0
    assert len({(batch.tile, batch.first) for batch in worker.batches}) == len(worker.batches)
    assert service.digest(job) == expected_digest(spp=20)


@pytest.mark.long
def test_undeleted_result_is_dropped_as_duplicate(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(entries: list[Entry]) -> None:
        if entries:
            raise redis.ConnectionError("away")

    scene = service.ready_scene()
    results = service.farm.engine._results
    delete = results.delete
    monkeypatch.setattr(results, "delete", refuse)
    job = service.submit(scene)
    until(lambda: worker.redis.xlen(RESULTS) > 2, "results are read and stay in the stream")
    monkeypatch.setattr(results, "delete", delete)
    service.wait_for(job, "finished")
    until(lambda: worker.redis.xlen(RESULTS) == 0, "the stream is trimmed")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_slow_redis_is_reported(service: Service, worker: PeerWorker, redis_server: running_redis) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=30)
    until(lambda: service.job(job)["progress"] > 0.1, "the job is under way")
    assert redis_server.process is not None
    redis_server.process.send_signal(signal.SIGSTOP)
    try:
        until(lambda: service.http.get("/readyz").status_code == 503, "the service says that it cannot work", 8)
    finally:
        redis_server.process.send_signal(signal.SIGCONT)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=30)


@pytest.mark.long
def test_older_worker_without_reported_leases_keeps_batches(service: Service) -> None:
    go = threading.Event()
    with service.worker(slots=1) as worker:

        def hold(batch: RenderBatch) -> None:
            worker.current = {key: value for key, value in worker.current.items() if key != "batch"}
            go.wait(20)

        worker.on_batch = hold
        job = service.submit(service.ready_scene(), spp=1, tile_size=64)
        until(lambda: bool(worker.batches), "the worker holds the batch")
        time.sleep(4.5)
        assert service.farm.engine.snapshot.counts["lost"] == 0, "it is seen there, and not handed out again"
        go.set()
        service.wait_for(job, "finished")
        assert len(worker.batches) == 1


def test_batches_of_vanished_worker_are_dispatched_at_once(tmp_path, redis_server: running_redis) -> None:  # type: ignore[no-untyped-def]
    service = Service(tmp_path / "data", redis_server, batch_deadline=60.0)
    held, other = service.worker(name="held", slots=1), service.worker(name="other", slots=1)
    with held:
        held.on_batch = lambda batch: (until(lambda: held._stop.is_set(), "the worker is stopped"), False)[1]
        job = service.submit(service.ready_scene())
        until(lambda: bool(held.current), "the worker holds a batch")
        time.sleep(1.5)
    with other:
        service.wait_for(job, "finished", timeout=10)
    assert service.digest(job) == expected_digest()
    service.stop()


def test_duplicate_late_and_damaged_results_change_nothing(service: Service, worker: PeerWorker) -> None:
    def twice(batch: RenderBatch) -> None:
        worker.answer(batch)
        about = worker._about(batch)
        worker.send({"type": "batch", **about, "seconds": 0.1}, b"these are no sums")
        worker.send({"type": "batch", "job": batch.job})
        worker.redis.xadd(RESULTS, {"nonsense": "1"})
        worker.redis.xadd(RESULTS, {"event": "[]"})
        overlapping = Result({"type": "batch", **about, "count": batch.count + 1, "seconds": 0.1}, b"")
        worker.redis.xadd(RESULTS, overlapping.to_fields())  # type: ignore[arg-type]

    worker.on_batch = twice
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()
    until(lambda: worker.redis.xlen(RESULTS) == 0, "the stream is trimmed")
    assert service.http.get("/readyz").status_code == 200


def test_batch_failing_three_times_fails_job(service: Service, worker: PeerWorker) -> None:
    def fail(batch: RenderBatch) -> None:
        if batch.tile[:2] == (16, 16):
            raise ValueError("the texture is on fire")

    worker.on_batch = fail
    job = service.submit(service.ready_scene())
    failed = service.wait_for(job, "failed")
    assert "on fire" in failed["error"]
    assert failed["reproduce"] == "rayfarm render scene.glb"
    assert sum(b.tile[:2] == (16, 16) for b in worker.batches) == 3
    worker.on_batch = lambda batch: None
    service.patch(job, state="running")
    assert service.wait_for(job, "finished")["error"] is None
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_batches_returned_by_only_worker_wait(service: Service, worker: PeerWorker) -> None:
    def hand_back(batch: RenderBatch) -> bool:
        worker.send({"type": "batch-returned", **worker._about(batch), "error": "peer returned a batch: there is no room"})
        return False

    worker.on_batch = hand_back
    job = service.submit(service.ready_scene())
    until(lambda: "there is no room. It will be retried." in (service.job(job)["message"] or ""), "the job says why it waits")
    time.sleep(3.0)
    assert service.job(job)["state"] == "running"
    assert 4 < len(worker.batches) < 30, "it is tried again now and then, not as fast as it can be"
    worker.on_batch = lambda batch: None
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_batch_failing_once_is_retried(service: Service, worker: PeerWorker) -> None:
    failed: list[RenderBatch] = []

    def fail(batch: RenderBatch) -> None:
        if not failed:
            failed.append(batch)
            raise ValueError("a cosmic ray")

    worker.on_batch = fail
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_damaged_film_is_rendered_again(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    broken, sound = service.submit(scene, spp=2), service.submit(scene, spp=2, seed=1)
    service.wait_for(broken, "finished")
    service.wait_for(sound, "finished")
    service.stop()
    (service.options["data"] / "films" / f"{broken}.sqlite").write_bytes(b"this is no film" * 1000)
    service.start()
    service.patch(broken, spp=8)
    service.patch(sound, spp=8)
    for job, seed in ((broken, 0), (sound, 1)):
        until(lambda job=job: service.job(job)["samples"] == 64 * 48 * 8, "it has all samples")
        service.wait_for(job, "finished")
        assert service.digest(job) == expected_digest(seed=seed)
