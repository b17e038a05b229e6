"""Tests of path guides at a worker: one slot trains and stores a guide, and another reads it in place of training."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from protocol.contract import BlobRef, TrainPathGuide
from renderer import jit
from renderer.arrays.guide import COUNT, RADIANCE_COLUMNS, Guide, portal_guide
from renderer.guiding import train
from renderer.guiding.stored_guide import read_guide, write_guide
from renderer.settings import RenderSettings, View
from tests.renderer.builders import emitter, scene, square
from worker.exchange.errors import LinkError, RefusedError, UnfitError
from worker.work import path_guides
from worker.work.path_guides import train_frame_guide, use_stored_guide

SETTINGS = RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0)), guiding="on")
SCENE = scene([emitter(1.0)], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),))
WORK = TrainPathGuide("w", "job", 0, jit.kind(), "b" * 64, SETTINGS)


def _guide() -> Guide:
    frame = np.zeros(7, np.float32)
    frame[COUNT:] = 1
    portal = np.array([[0, 1, 2, 0.5]], np.float32)
    return portal_guide(frame, portal, np.ones((1, RADIANCE_COLUMNS), np.float32))


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns a worker whose service and cache are a folder, and whose guide is trained already."""
    monkeypatch.setattr(train, "_kept", [])
    monkeypatch.setattr(path_guides, "mapped_scene", lambda worker, sha256: SCENE)
    monkeypatch.setattr(path_guides, "guide_of", lambda settings, scene, prepare_pilot: _guide())

    def store(path: Path) -> BlobRef:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
        (tmp_path / sha256).write_bytes(path.read_bytes())
        return BlobRef("", sha256, path.stat().st_size)

    cache = SimpleNamespace(path=lambda sha256: tmp_path / sha256, add_copy=lambda path, sha256: None)
    return SimpleNamespace(name="w", link=SimpleNamespace(store=store), cache=cache)


def test_stored_guide_is_read_by_another_slot(worker: Any) -> None:
    sha256 = train_frame_guide(worker, WORK)["sha256"]
    assert sha256 == hashlib.sha256(write_guide(_guide())).hexdigest()
    use_stored_guide(worker, SCENE, SETTINGS, sha256)
    kept = train.kept_guide(SCENE, SETTINGS, lambda: pytest.fail("it is trained again"))
    assert kept is not None and all(np.array_equal(a, b) for a, b in zip(kept, _guide(), strict=True))
    worker.cache = None
    use_stored_guide(worker, SCENE, SETTINGS, sha256)  # not read again


def test_settings_without_guides_have_an_empty_one(worker: Any) -> None:
    work = replace(WORK, settings=replace(SETTINGS, integrator="direct"))
    sha256 = train_frame_guide(worker, work)["sha256"]
    assert read_guide(worker.cache.path(sha256).read_bytes()) is None


def test_other_release_of_the_renderer_is_refused(worker: Any) -> None:
    with pytest.raises(UnfitError, match="another release"):
        train_frame_guide(worker, replace(WORK, kind="another"))


@pytest.mark.parametrize("trouble", [LinkError("no answer"), RefusedError("it is deleted"), OSError("no disk"), None])
def test_guide_that_cannot_be_read_is_trained(worker: Any, trouble: Exception | None) -> None:
    def path(sha256: str) -> Path:
        if trouble is not None:
            raise trouble
        return Path(__file__)  # no guide

    worker.cache.path = path
    use_stored_guide(worker, SCENE, SETTINGS, "a" * 64)
    use_stored_guide(worker, SCENE, SETTINGS, "")
    assert not train.is_guide_kept(SCENE, SETTINGS)


def test_requests_are_sent_as_json() -> None:
    assert TrainPathGuide.from_json(WORK.to_json()) == WORK
