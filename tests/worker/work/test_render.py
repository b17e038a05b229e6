"""Tests of the function by which a slot renders a batch."""

from __future__ import annotations

import hashlib
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from protocol.contract import RenderBatch
from protocol.sums import unpack_sums
from renderer.arrays.kernel_variant import variant_of
from renderer.render import render_batch
from renderer.scene import compiled as compiled_file
from renderer.settings import RenderSettings, Tile, View
from tests.renderer.builders import emitter, scene, square
from worker.exchange.cache import BlobCache
from worker.exchange.errors import DamagedError, LinkError, MachineError, NotAFarmError, RefusedError, TokenError
from worker.exchange.link import FarmAnswer, Link
from worker.work import open_scenes
from worker.work import render as slot

SETTINGS = RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0)))
TILE = Tile(0, 0, 8, 8)


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(slot, "is_warm", lambda settings, variant: True)
    made = scene([emitter(1.0)], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),))
    compiled_file.save(made, tmp_path / "compiled")
    open_scenes._open.clear()
    cache = SimpleNamespace(path=lambda sha256: tmp_path / "compiled")
    return SimpleNamespace(name="w", slots=1, cards=(), link=object(), cache=cache, made=made)


def test_slot_reports_kernel_compilation(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    batch = RenderBatch("b", "job", 0, "sha", TILE, 0, 2, SETTINGS)
    told: list[Any] = []
    monkeypatch.setattr(slot, "is_warm", lambda settings, variant: False)
    monkeypatch.setattr(slot, "make_kernel_ready", lambda *arguments: told.append(arguments))
    result = slot.render(worker, batch, told.append, lambda: told.append("begins")).result()
    assert told == ["begins", True, (worker.link, SETTINGS, variant_of(worker.made)), False, "begins"]
    assert result.sums is not None
    np.testing.assert_array_equal(unpack_sums(result.sums, TILE), render_batch(worker.made, SETTINGS, TILE, 0, 2).sums)

    told.clear()
    monkeypatch.setattr(slot, "is_warm", lambda settings, variant: True)
    assert slot.render(worker, batch, told.append, lambda: told.append("begins")).result().sums == result.sums
    assert told == ["begins"]


def test_scene_that_is_downloaded_delays_no_other(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, may_end, opened = threading.Event(), threading.Event(), list[str]()

    def open_scene(cache: Any, sha256: str) -> Any:
        opened.append(sha256)
        if sha256 == "slow":
            begun.set()
            assert may_end.wait(10)
        return sha256

    monkeypatch.setattr(open_scenes, "open_scene", open_scene)
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(open_scenes.mapped_scene, worker, "slow") for _ in range(2)]
        assert begun.wait(10)
        assert open_scenes.mapped_scene(worker, "other") == "other"
        may_end.set()
        assert [each.result() for each in waiting] == ["slow", "slow"]
    assert opened == ["slow", "other"], "each is mapped once"
    open_scenes._open.clear()


def test_scene_of_next_batch_is_opened_in_advance(worker: Any, tmp_path: Path) -> None:
    asked: list[str] = []

    def path(sha256: str) -> Path:
        asked.append(sha256)
        return tmp_path / ("compiled" if sha256 == "sha" else "absent")

    worker.cache = SimpleNamespace(path=path)
    with open_scenes.SceneOpener(worker) as opener:
        opener.open("sha")
        opener.open("other")  # its error is that of the batch, later
        opener.open(None)
    assert (asked.count("sha"), "other" in asked) == (1, True)
    assert [open_scenes.is_mapped(each) for each in ("sha", "other", None, [])] == [True, False, False, False]
    told: list[str] = []
    batch = RenderBatch("b", "job", 0, "sha", TILE, 0, 2, SETTINGS)
    assert slot.render(worker, batch, lambda _: None, lambda: told.append("begins")).sums is not None
    assert (asked.count("sha"), told) == (1, ["begins"])


BATCH = RenderBatch("b", "job", 0, "0" * 64, TILE, 0, 2, SETTINGS)


@pytest.mark.parametrize("trouble", [LinkError, DamagedError, TokenError, NotAFarmError, MachineError])
def test_worker_fault_returns_batch_after_retries(worker: Any, monkeypatch: pytest.MonkeyPatch, trouble: type[Exception]) -> None:
    asked: list[str] = []

    def path(sha256: str) -> Path:
        asked.append(sha256)
        raise trouble("it is away")

    worker.cache = SimpleNamespace(path=path)
    clock = [0.0]
    passing = SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda seconds: clock.append(clock.pop() + seconds))
    monkeypatch.setattr("worker.exchange.retry.time", passing)
    monkeypatch.setattr(slot, "PATIENCE_S", 5.0)
    event = slot.render(worker, BATCH, lambda is_so: None).event
    assert (event["type"], event["batch"], event["worker"]) == ("batch-returned", "b", "w")
    assert "it is away" in event["error"]
    assert len(asked) > 2


def test_temporary_error_is_retried(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    there = worker.cache.path("")
    answers: list[Any] = [LinkError("away"), MachineError("full"), there]

    def path(sha256: str) -> Path:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    worker.cache = SimpleNamespace(path=path)
    monkeypatch.setattr("worker.exchange.retry.time.sleep", lambda seconds: None)
    assert slot.render(worker, BATCH, lambda is_so: None).event["type"] == "batch"


def test_missing_scene_fails_batch(worker: Any) -> None:
    def path(sha256: str) -> Path:
        raise RefusedError("http://farm answers 404")

    worker.cache = SimpleNamespace(path=path)
    event = slot.render(worker, BATCH, lambda is_so: None).event
    assert event["type"] == "batch-failed"
    assert "answers 404" in event["error"]


@pytest.mark.parametrize("damage", ["cut", "header", "empty", "gone"])
def test_compiled_scene_damaged_on_disk_is_downloaded_again(tmp_path: Path, worker: Any, damage: str) -> None:
    data = (tmp_path / "compiled").read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()

    class Service(Link):
        def fetch(self, sha256: str, out: Any) -> None:
            out.write(data)

    cache = BlobCache(Service("http://service.invalid", "token"), FarmAnswer("", "", ""), tmp_path / "cache")
    path = cache.path(sha256)
    spoilt = {"cut": data[:-100], "header": b"\0" * 100 + data[100:], "empty": b"", "gone": b""}[damage]
    path.write_bytes(spoilt)
    if damage == "gone":  # another slot evicts it between the check and the opening
        found, first = cache.path, iter([tmp_path / "nowhere"])
        cache.path = lambda sha256, size=None: next(first, None) or found(sha256)  # type: ignore[method-assign]
        path.write_bytes(data)
    worker.cache = cache
    event = slot.render(worker, RenderBatch(**{**vars(BATCH), "compiled": sha256}), lambda is_so: None).event
    assert event["type"] == "batch", event
    assert path.read_bytes() == data


def test_unreadable_batch_gives_error_message(worker: Any) -> None:
    event = slot.unreadable_batch_event(worker, {"batch": "b", "job": "j"}, ValueError("RenderBatch lacks 'tile'")).event
    assert event["type"] == "batch-failed"
    assert "lacks 'tile'" in event["error"]
    assert "same release" in event["error"]
