"""Tests of malformed messages from workers: each is stored and counted, and the pictures of jobs do not change."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
import redis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from protocol.contract import RESULTS, RenderBatch, render_queue, worker_key
from protocol.site import site_key
from protocol.terms import offer_key
from protocol.view_parts import VIEW_ANSWERS
from protocol.vitals import vitals_key
from service.scheduling.fleet.dead_letters import FILE, MAX_KEPT
from service.scheduling.incoming import messages
from service.store.models import Scene
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest

SHA = "a" * 64
REF = {"path": "a", "sha256": SHA, "size": 1}
INFO: dict[str, Any] = {
    "kind": "test-kind",
    "compiled": {"path": "", "sha256": SHA, "size": 8},
    "thumbnail": None,
    "cameras": [{"name": "", "view": {}}],
    "counts": {},
    "bounds": [],
    "animations": [],
    "warnings": [],
    "defaults": {},
    "seconds": 0.01,
}
BATCH = {"batch": "b", "frame": 0, "tile": [0, 0, 16, 16], "first": 0, "count": 1, "worker": "odd"}
SENSE: dict[str, dict[str, Any]] = {
    "batch": {**BATCH, "seconds": 0.1, "bad": [], "bad_count": 0},
    "batch-failed": {**BATCH, "error": "an error"},
    "batch-returned": {**BATCH, "error": "an error"},
    "denoised": {"work": "w", "sha256": SHA, "version": "1", "samples": 1},
    "vectors-made": {"work": "w", "sha256": SHA},
    "path-guide-trained": {"work": "w", "sha256": SHA},
    "prepare-started": {"kind": "test-kind"},
    "prepare-progress": {"kind": "test-kind", "step": "x", "fraction": 0.5},
    "prepared": {"kind": "test-kind", "info": INFO},
    "thumbnail-made": {"kind": "test-kind", "thumbnail": REF},
    "prepare-returned": {"kind": "test-kind", "error": "an error"},
    "frame-prepared": {
        "work": "w",
        "kind": "test-kind",
        "frame": 0,
        "info": {"compiled": None, "view": {}, "defaults": {}, "warnings": [], "seconds": 0.1},
    },
    "frames-returned": {"work": "w", "kind": "test-kind", "error": "an error"},
}
ODD = st.recursive(
    st.none()
    | st.booleans()
    | st.sampled_from([0, -1, 1 << 31, 1 << 63, -(10**30), 0.5, float("nan"), float("inf"), "", "\0", "\ud800", "x" * 300])
    | st.text(max_size=5),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(max_size=4), inside, max_size=3),
    max_leaves=6,
)


@st.composite
def events(draw: st.DrawFn) -> Any:
    """Generates messages with missing or wrong fields, or with an unknown type, job, scene or frame."""
    type = draw(st.sampled_from(list(SENSE)))
    event = {"type": type, "job": draw(st.sampled_from(["JOB", "nosuch"])), "scene": "nosuch", "worker": "odd", **SENSE[type]}
    for name in draw(st.lists(st.sampled_from(sorted(event)), max_size=3, unique=True)):
        if draw(st.booleans()):
            event[name] = draw(ODD)
        else:
            del event[name]
    if isinstance(info := event.get("info"), dict) and info:
        event["info"] = {**info, **draw(st.dictionaries(st.sampled_from(sorted(info)), ODD, max_size=2))}
    return draw(st.one_of(st.just(event), ODD)) if draw(st.integers(0, 9)) == 0 else event


FIELDS = st.one_of(
    st.builds(lambda event, sums: {b"event": json.dumps(event).encode(), **sums}, events(), st.fixed_dictionaries(
        {}, optional={b"sums": st.binary(max_size=80)})),
    st.dictionaries(st.sampled_from([b"event", b"sums", b"other", b""]), st.binary(max_size=60), min_size=1),
)  # fmt: skip


def test_arbitrary_messages_do_not_change_picture(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(scene, spp=40)

    @settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=settings.default.max_examples // 2)
    @given(st.lists(FIELDS, min_size=20, max_size=40))
    def pour(entries: list[dict[bytes, bytes]]) -> None:
        for fields in entries:
            named = {name: value.replace(b'"JOB"', json.dumps(job).encode()) for name, value in fields.items()}
            worker.redis.xadd(RESULTS, named)  # type: ignore[arg-type]
        assert "fault" not in service.http.get("/readyz").text

    pour()
    service.wait_for(job, "finished", 60)
    assert service.digest(job) == expected_digest(spp=40)
    until(lambda: worker.redis.xlen(RESULTS) == 0, "the stream is empty")
    assert service.http.get("/readyz").status_code == 200
    assert service.scene(scene)["status"] == "ready"
    count = service.farm.engine.snapshot.counts["put_aside"]
    assert count > 50
    assert f"rayfarm_messages_put_aside_total {float(count)}" in service.http.get("/metrics").text
    until((service.options["data"] / FILE).exists, "the list is written")
    listed = [json.loads(line) for line in (service.options["data"] / FILE).read_text().splitlines()]
    assert 0 < len(listed) <= MAX_KEPT
    assert all(each["why"] and each["where"].startswith("results") for each in listed)


@pytest.mark.long
def test_frame_failure_message_does_not_fail_still(service: Service, worker: PeerWorker) -> None:
    """Checks that a message about a failed frame does not fail the only frame of a still image.

    Otherwise the job would never end.
    """

    def lie(batch: RenderBatch) -> None:
        worker.send({"type": "frame-prepared", "job": batch.job, "worker": "odd", **SENSE["frame-prepared"]})
        about = {"work": "w", "kind": "test-kind", "frame": 0, "worker": "odd"}
        worker.send({"type": "frame-failed", "job": batch.job, **about, "error": "it is not so"})

    worker.on_batch = lie
    job = service.submit(service.ready_scene(), spp=10)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=10)


POISON = {**INFO, "blend": {"main": "x", "files": [{**REF, "parts": 5}]}}


def test_looping_message_goes_to_dead_letters_after_restart(service: Service) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        scenes = ("nosuch", service.upload())
        service.stop()
        for scene in scenes:
            event = {"type": "prepared", "scene": scene, "kind": "k", "worker": "w", "info": {**POISON, "kind": "k"}}
            store.xadd(RESULTS, {"event": json.dumps(event)})
        service.start()
        until(lambda: store.xlen(RESULTS) == 0, "both are put aside")
        until(lambda: service.http.get("/readyz").status_code == 200, "it is ready")
        assert service.farm.engine.snapshot.counts["put_aside"] == 2


@pytest.mark.long
@pytest.mark.parametrize("where", ["merge", "note"])
def test_error_with_one_batch_dispatches_it_again(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """Checks that a batch whose result raises an error in the service is dispatched again and stops no other batch.

    where: whether the error is raised before the film has accepted the result ("merge"), or afterwards ("note").
    """
    left = [2]  # a batch that fails three times ends its job
    answers = service.farm.engine._answers
    name = {"merge": "_add", "note": "_record_batch"}[where]
    real = getattr(answers, name)

    def instead(job: Any, what: Any, *more: Any) -> Any:
        each = [answer.message for answer in what] if where == "merge" else [what.message]
        if any(message.tile[:2] == (16, 16) for message in each) and left[0] > 0:
            left[0] -= len(each) == 1
            raise KeyError("a bug")
        return real(job, what, *more)

    monkeypatch.setattr(answers, name, instead)
    with service.worker(name="other"):
        job = service.submit(service.ready_scene(), spp=20)
        service.wait_for(job, "finished", 150)  # a batch handed out again waits for its deadline each time
    assert service.digest(job) == expected_digest(spp=20)
    assert service.farm.engine.snapshot.counts["put_aside"] >= 1


@pytest.mark.long
def test_message_that_crashes_validator_goes_to_dead_letters(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_sha256 = messages.is_sha256

    def instead(text: str) -> bool:
        if text == SHA:
            raise ZeroDivisionError
        return is_sha256(text)

    monkeypatch.setattr(messages, "is_sha256", instead)
    worker.send({"type": "prepared", "scene": "nosuch", "kind": "test-kind", "worker": "odd", "info": INFO})
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    assert service.farm.engine.snapshot.counts["put_aside"] == 1


def test_thumbnail_of_ready_scene_is_stored_once(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    about = {"type": "thumbnail-made", "kind": "test-kind", "worker": "odd"}
    worker.send({**about, "scene": "nosuch", "thumbnail": REF})
    worker.send({**about, "scene": scene, "thumbnail": REF})
    worker.send({**about, "scene": scene, "thumbnail": {**REF, "sha256": "b" * 64}})
    until(lambda: service.http.get(f"/api/scenes/{scene}").json()["thumbnail"], "the thumbnail is known")
    service.wait_for(service.submit(scene), "finished")  # the third message has been read by now
    with service.farm.sessions() as session:
        row = session.get(Scene, scene)
        assert row is not None and row.info is not None
        assert row.info["thumbnail"]["sha256"] == SHA
        assert SHA in row.blobs
    assert service.farm.engine.snapshot.counts["put_aside"] == 0


@pytest.mark.long
def test_keys_of_wrong_type_are_repaired(service: Service, worker: PeerWorker) -> None:
    store = worker.redis

    def spoil(batch: RenderBatch) -> None:
        if batch.first == 3:
            for key in (RESULTS, VIEW_ANSWERS, render_queue("test-kind"), "unacked"):
                store.delete(key)
                store.set(key, "another type")
            for key in (worker_key("peer"), offer_key("peer"), vitals_key("peer"), site_key("peer"), worker_key("odd")):
                store.delete(key)
                store.lpush(key, "another type")

    worker.on_batch = spoil
    job = service.submit(service.ready_scene(), spp=10)
    service.wait_for(job, "finished", 60)
    assert service.digest(job) == expected_digest(spp=10)
    until(lambda: store.type(worker_key("odd")) == b"none", "others' keys are deleted too", 30)
    until(lambda: store.type("unacked") in (b"none", b"hash"), "and the queue's", 30)
    assert service.http.get("/readyz").status_code == 200


@pytest.mark.long
def test_exhausted_stream_ids_are_reset(service: Service, worker: PeerWorker) -> None:
    worker.redis.xadd(RESULTS, {"event": "{}"}, id="18446744073709551615-18446744073709551615")
    job = service.submit(service.ready_scene(), spp=4)
    service.wait_for(job, "finished", 60)
    assert service.digest(job) == expected_digest(spp=4)


@given(st.binary(max_size=50) | st.builds(lambda value: json.dumps(value).encode(), ODD))
@settings(suppress_health_check=list(HealthCheck), deadline=None)
def test_arbitrary_worker_keys_are_tolerated(service: Service, value: bytes) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        for key in (worker_key("odd"), offer_key("odd"), vitals_key("odd"), site_key("odd"), b"rayfarm:worker:\xff"):
            store.set(key, value)
        service.farm.engine._workers.refresh(now=True)
        assert not service.farm.engine._workers.roster.reports
