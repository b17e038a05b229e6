"""Tests of workers of another release: messages of release 0.1.0, recorded in tests/data.

A job is finished by the kind of worker that began it and by no other; unreadable messages are ignored.
"""

from __future__ import annotations

import base64
import json
import time
from types import SimpleNamespace
from typing import Any

import pytest
import redis

from protocol.contract import (
    HEARTBEAT_TTL_S,
    RESULTS,
    RenderBatch,
    Result,
    WorkerReport,
    prepare_queue,
    render_queue,
    worker_key,
)
from tests.helpers import ROOT
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest
from worker.work.render import unreadable_batch_event

OLD = json.loads((ROOT / "tests" / "data" / "release-0.1.0.json").read_text())
ASKED = {key: OLD["job"]["settings"][key] for key in ("width", "height", "seed", "light_samples", "clamp_indirect")}
ASKED |= {"spp": 2, "tile_size": 16, "environment": {"color": [0.5, 0.6, 0.7], "strength": 2.0, "rotation": 30.0}}


class OldWorker(PeerWorker):
    """A worker that sends exactly the fields of release 0.1.0, without those of this release."""

    def report(self) -> None:
        said = OLD["report"] | {"name": self.name, "kind": self.kind, "slots": self.slots, "started": time.time()}
        doing = {key: self.current[key] for key in ("job", "frame", "tile", "first", "count") if key in self.current}
        said["current"] = [doing, *[{}] * (self.slots - 1)]
        self.redis.set(worker_key(self.name), json.dumps(said), ex=HEARTBEAT_TTL_S)

    def send(self, event: dict[str, Any], sums: bytes | None = None) -> None:
        frozen = OLD["events"][event["type"]]
        super().send({key: event[key] for key in frozen}, sums)


@pytest.fixture
def store(service: Service) -> redis.Redis:
    return redis.Redis.from_url(str(service.options["redis_url"]))


def test_older_worker_renders_same_film(service: Service) -> None:
    with OldWorker(str(service.options["redis_url"]), service.url, "the farm's token", kind=OLD["report"]["kind"]) as worker:
        job = service.submit(service.ready_scene(), **ASKED)
        assert service.wait_for(job, "finished")["kind"] == worker.kind
        assert service.digest(job) == OLD["digest"]
        assert service.http.get("/api/workers").json()[0]["name"] == worker.name


def test_job_waits_for_its_worker_kind(service: Service) -> None:
    old_kind = OLD["report"]["kind"]
    address = str(service.options["redis_url"]), service.url, "the farm's token"
    with OldWorker(*address, name="old", kind=old_kind) as old:
        old.on_batch = lambda batch: time.sleep(0.05)
        job = service.submit(service.ready_scene(), spp=64)
        until(lambda: service.job(job)["samples"] > 0, "the old worker has begun")
    with service.worker(name="new", kind="0.2.0-12345678-x86-64-v3") as new:
        sentence = f"Waits for a worker of the kind {old_kind}"
        until(lambda: sentence in (service.job(job)["message"] or ""), "it says what it waits for", 20, lambda: service.job(job))
        other = service.submit(service.job(job)["scene"])
        assert service.wait_for(other, "finished")["kind"] == new.kind, "others go on"
        assert {batch.job for batch in new.batches} == {other}
        with OldWorker(*address, name="old", kind=old_kind):
            assert service.wait_for(job, "finished")["kind"] == old_kind
    assert service.digest(job) == expected_digest(spp=64)


@pytest.mark.long
def test_job_of_missing_kind_is_restarted_on_request(service: Service) -> None:
    """A new job for workers of another kind renders the same picture; the old job keeps its samples, and can be continued."""
    old_kind = OLD["report"]["kind"]
    address = str(service.options["redis_url"]), service.url, "the farm's token"
    with OldWorker(*address, name="old", kind=old_kind) as old:
        old.on_batch = lambda batch: time.sleep(0.05)
        job = service.submit(service.ready_scene(), spp=64)
        until(lambda: service.job(job)["samples"] > 0, "the old worker has begun")
        assert service.job(job)["stranded"] is False
        service.http.patch(f"/api/jobs/{job}", json={"name": "shot 12", "priority": 3, "note": "for Friday"}).raise_for_status()
    until(lambda: not service.http.get("/api/workers").json(), "the old worker is gone")
    assert service.job(job)["stranded"] is False, "the next worker may be of its kind"
    with service.worker(name="new", kind="0.2.0-12345678-x86-64-v3") as new:
        until(lambda: service.job(job)["stranded"], "its kind is gone", 20, lambda: service.job(job))
        answer = service.http.post(f"/api/jobs/{job}/anew")
        assert answer.status_code == 201, answer.text
        made = answer.json()
        assert made["id"] != job
        assert [made[key] for key in ("name", "priority", "note", "spp")] == ["shot 12", 3, "for Friday", 64]
        assert service.wait_for(made["id"], "finished")["kind"] == new.kind
        assert service.digest(made["id"]) == expected_digest(spp=64)
        left = service.job(job)
        assert (left["state"], left["stranded"], left["kind"]) == ("cancelled", False, old_kind)
        assert left["samples"] > 0
        again = service.http.post(f"/api/jobs/{job}/anew")
        assert (again.status_code, "only an unfinished job" in again.json()["detail"]) == (409, True)
    service.http.patch(f"/api/jobs/{job}", json={"state": "running"}).raise_for_status()
    with OldWorker(*address, name="old", kind=old_kind):
        assert service.wait_for(job, "finished")["kind"] == old_kind


@pytest.mark.long
def test_failed_restart_leaves_job_unchanged(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.05)
    job = service.submit(service.ready_scene(), spp=64)
    until(lambda: service.job(job)["samples"] > 0, "it has begun")
    service.farm.settings.min_free_bytes = 1 << 62
    assert service.http.post(f"/api/jobs/{job}/anew").status_code == 507
    service.farm.settings.min_free_bytes = 0
    worker.on_batch = lambda batch: None
    assert service.wait_for(job, "finished")
    assert service.http.post("/api/jobs/gone/anew").status_code == 404


@pytest.mark.long
def test_unreadable_reports_are_ignored(service: Service, worker: PeerWorker, store: redis.Redis) -> None:
    whole = json.loads(WorkerReport("newer", "host", 1, 2, "cpu", worker.kind, "starting", 0.0).to_bytes())
    store.set(worker_key("newer"), json.dumps(whole | {"gpus": [1], "region": "attic"}))
    for number, held in enumerate(
        [b"", b"\xff", b"[]", b"{}", json.dumps(whole | {"slots": "many"}), json.dumps(whole | {"state": "asleep"}), b"[" * 9999]
    ):
        store.set(worker_key(f"odd-{number}"), held)
    store.rpush(worker_key("a list"), b"1")
    job = service.submit(service.ready_scene())
    assert service.wait_for(job, "finished")
    until(lambda: len(service.http.get("/api/workers").json()) == 2, "the newer one is shown")
    assert {row["name"] for row in service.http.get("/api/workers").raise_for_status().json()} == {"newer", worker.name}


@pytest.mark.long
def test_messages_for_older_service_are_ignored(service: Service, store: redis.Redis) -> None:
    kind = OLD["report"]["kind"]
    service.stop()
    for event in OLD["events"].values():
        store.xadd(RESULTS, Result(event, base64.b64decode(OLD["sums"]) if event["type"] == "batch" else None).to_fields())  # type: ignore[arg-type]
    for fields in ({"event": "{"}, {"event": "[]"}, {"event": '{"type": 7}'}, {"event": '{"type": "batch"}'}, {"other": "1"}):
        store.xadd(RESULTS, fields)  # type: ignore[arg-type]
    for kind_of_event in ("batch-failed", "batch-returned", "prepare-returned", "prepared", "denoised", "of a newer release"):
        store.xadd(RESULTS, {"event": json.dumps({"type": kind_of_event, "job": "gone", "scene": "gone"})})
    for queue in (render_queue(kind), prepare_queue(kind)):
        store.rpush(queue, json.dumps({"body": "e30=", "headers": {}, "properties": {}}))
    service.start()
    until(lambda: not store.exists(render_queue(kind), prepare_queue(kind)), "what was asked for before is asked for no more")
    with OldWorker(str(service.options["redis_url"]), service.url, "the farm's token", kind=kind):
        job = service.submit(service.ready_scene(), **ASKED)
        service.wait_for(job, "finished")
        assert service.digest(job) == OLD["digest"]
    until(lambda: store.xlen(RESULTS) == 0, "the stream is empty")


@pytest.mark.long
def test_returned_batches_are_rendered_again(service: Service, worker: PeerWorker) -> None:
    """Batches returned after a lost connection are rendered again, however often; the scene is not blamed."""
    returns: dict[tuple[Any, ...], int] = {}

    def hand_back(batch: RenderBatch) -> bool | None:
        about = worker._about(batch)
        key = (batch.tile, batch.first, batch.count)
        returns[key] = returns.get(key, 0) + 1
        if returns[key] > 8:
            return None
        worker.send({"type": "batch-returned", **about, "error": "peer hands a batch back: no answer from the service"})
        return False

    worker.on_batch = hand_back
    job = service.submit(service.ready_scene(), width=16, height=16, spp=1)
    final = service.wait_for(job, "finished")
    assert max(returns.values()) > 8
    assert final["error"] is None
    assert service.digest(job) == expected_digest(16, 16, 1)


def test_returned_scene_is_prepared_again(service: Service, worker: PeerWorker) -> None:
    real = worker._prepare
    left = [None] * 5

    def hand_back(scene: str) -> None:
        if left:
            left.pop()
            about = {"scene": scene, "kind": worker.kind, "worker": worker.name}
            worker.send({"type": "prepare-started", **about})
            worker.send({"type": "prepare-returned", **about, "error": "peer returned the scene: there is no room."})
        else:
            real(scene)

    worker._prepare = hand_back  # type: ignore[method-assign]
    service.ready_scene()
    assert not left


@pytest.mark.long
def test_worker_that_cannot_parse_batches_is_quarantined(service: Service) -> None:
    """Checks that a worker that cannot read its batches is paused, and that its jobs are rendered by another kind of worker.

    The paused worker has most of the slots, so the job was started with its kind.
    """

    def misunderstand(batch: RenderBatch) -> None:
        context: Any = SimpleNamespace(name="old")
        raise ValueError(unreadable_batch_event(context, {}, TypeError("unexpected 'sky_samples'")).event["error"])

    scene = service.upload()
    with service.worker(name="old", kind="0.1.0-12345678-x86-64-v3", slots=64) as old:
        old.on_batch = misunderstand
        job = service.submit(scene, spp=16)
        with service.worker(name="new"):
            service.wait_for(job, "finished")
            assert service.digest(job) == expected_digest(spp=16)
            workers = {each["name"]: each for each in service.http.get("/api/workers").json()}
            assert (workers["new"]["state"], workers["old"]["state"]) == ("ready", "paused")
            sentence = "old cannot read the batch (unexpected 'sky_samples'). Run the same release of Rayfarm on all machines."
            assert workers["old"]["message"] == f"{sentence} Then resume it."
            assert service.job(job)["kind"] == workers["new"]["kind"]
            service.restart()
            assert service.job(job)["kind"] == workers["new"]["kind"]
        assert len(old.batches) >= 3
