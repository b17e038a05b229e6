"""Tests of arbitrary messages from workers: invalid ones are rejected, and the farm continues."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest

from protocol.contract import RESULTS, RenderBatch, Result, worker_key
from service.scheduling.incoming.messages import BatchDone, FramePrepared, PrepareDone, PrepareFailed, Unusable, parse_message
from service.scheduling.incoming.results import Entry
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest

BATCH = {"type": "batch", "batch": "b", "job": "j", "frame": 0, "tile": [0, 0, 8, 8], "first": 0, "count": 1, "seconds": 0.1}
INFO: dict[str, Any] = {
    "kind": "k",
    "compiled": {"path": "", "sha256": "0" * 64, "size": 1},
    "thumbnail": None,
    "cameras": [{"name": "", "view": {}}],
    "counts": {},
    "bounds": [[0, 0, 0], [1, 1, 1]],
    "animations": [],
    "warnings": [],
    "defaults": {},
    "seconds": 0.1,
}
FRAME: dict[str, Any] = {
    "type": "frame-prepared",
    "work": "w",
    "job": "j",
    "kind": "k",
    "worker": "x",
    "frame": 2,
    "info": {"compiled": None, "view": {}, "defaults": {}, "warnings": [], "seconds": 0.1},
}
NONSENSE: list[Any] = [
    None,
    [],
    {},
    {"type": 7},
    {"type": "batch"},
    {"type": "batch", "job": []},
    {**BATCH, "tile": 3},
    {**BATCH, "tile": [0, 0, 8]},
    {**BATCH, "count": 0},
    {**BATCH, "first": -1},
    {**BATCH, "first": 10**30},
    {**BATCH, "seconds": float("nan")},
    {**BATCH, "bad": [[1, 2]]},
    {**BATCH, "bad": [[1, 2, 3]] * 5000},
    {**BATCH, "worker": "a\0b"},
    {**BATCH, "type": "batch-failed", "error": 5},
    {"type": "prepared", "scene": "s", "kind": "k", "info": 5},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "compiled": {"path": "", "sha256": "../x", "size": 1}}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "bounds": [[float("inf")]]}},
    {"type": "prepared", "scene": "s", "kind": "another", "info": INFO},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "seconds": float("nan")}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "compiled": {"path": "", "sha256": "0" * 64, "size": -1}}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "cameras": []}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "cameras": [{"name": "a", "view": 5}]}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "defaults": {"spp": float("nan")}}},
    {"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "blend": {"main": "x", "files": [{"parts": 5}]}}},
    {
        "type": "prepared",
        "scene": "s",
        "kind": "k",
        "info": {**INFO, "blend": {"main": "x", "files": [{"path": "a", "sha256": "0" * 64, "size": 1, "parts": 5}]}},
    },
    {"type": "thumbnail-made", "scene": "s", "kind": "k", "thumbnail": {"path": "", "sha256": "../x", "size": 1}},
    {**FRAME, "info": {**FRAME["info"], "seconds": float("nan")}},
    {**FRAME, "info": {**FRAME["info"], "compiled": {"path": "", "sha256": "0" * 64, "size": 1, "parts": [["0" * 64, -5]]}}},
    {"type": "prepare-progress", "scene": "s", "kind": "k", "step": "x", "fraction": "much"},
    {"type": "prepare-progress", "scene": "s", "kind": "k", "step": "x", "fraction": float("nan")},
    {"type": "denoised", "work": {}, "sha256": 1, "version": 2, "samples": 3},
]
REPORTS: list[Any] = [
    7,
    [],
    {"name": "x"},
    {"current": [{"job": {}, "tile": 3}, {"scene": []}, {"batch": 5}]},
    {"slots": -1},
    {"slots": 10**9},
    {"slots": "two"},
    {"current": [5]},
    {"samples_per_s": float("nan")},
    {"state": "asleep"},
    {"a field of a newer release": 1},
]


@pytest.mark.parametrize("event", NONSENSE, ids=lambda event: str(event)[:150])
def test_invalid_messages_are_rejected(event: Any) -> None:
    with pytest.raises(Unusable):
        parse_message(Entry(b"1-0", Result(event)))


def test_batch_without_sums_is_rejected() -> None:
    with pytest.raises(Unusable):
        parse_message(Entry(b"1-0", Result(BATCH, None)))


def test_unknown_fields_are_ignored() -> None:
    assert isinstance(parse_message(Entry(b"1-0", Result({**BATCH, "watts": 3}, b""))), BatchDone)
    prepared = parse_message(Entry(b"1-0", Result({"type": "prepared", "scene": "s", "kind": "k", "info": {**INFO, "watts": 3}})))
    assert isinstance(prepared, PrepareDone)
    assert prepared.info.compiled.size == 1
    assert isinstance(parse_message(Entry(b"1-0", Result(FRAME))), FramePrepared)


def test_nul_characters_in_sentences_are_replaced() -> None:
    failed = parse_message(Entry(b"1-0", Result({"type": "prepare-failed", "scene": "s", "kind": "k", "error": "a\0b"})))
    assert isinstance(failed, PrepareFailed)
    assert failed.error == "a\ufffdb"


@pytest.mark.long
def test_invalid_messages_do_not_stop_jobs(service: Service, worker: PeerWorker) -> None:
    def chatter(batch: RenderBatch) -> None:
        for event in NONSENSE:
            about = {"job": batch.job} if isinstance(event, dict) and "job" in event else {}
            worker.redis.xadd(RESULTS, {"event": json.dumps({**event, **about} if about else event)})
        for i, report in enumerate(REPORTS):
            sense = json.loads(worker.redis.get(worker_key(worker.name)) or b"{}") if isinstance(report, dict) else {}
            text = json.dumps(
                {**sense, "name": f"strange {i}", "kind": "other", **report} if sense and "name" not in report else report
            )
            worker.redis.set(worker_key(f"strange {i}"), text, ex=60)
        worker.redis.set(worker_key("strange text"), b"\xff\x00{", ex=60)

    worker.on_batch = chatter
    job = service.submit(service.ready_scene(), spp=4)
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest(spp=4)
    until(lambda: worker.redis.xlen(RESULTS) == 0, "the stream is trimmed")
    time.sleep(1.2)  # one poll of the workers
    names = {known["name"] for known in service.http.get("/api/workers").json()}
    assert names == {worker.name, "strange 3", "strange 10"}, "what makes sense is there"
    assert service.http.get("/readyz").status_code == 200
    worker.on_batch = lambda batch: None
    worker.redis.delete(*worker.redis.keys(worker_key("strange*")))
