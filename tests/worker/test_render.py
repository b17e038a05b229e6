"""A batch, by the function that a slot calls."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from renderer.render import is_warm, render_batch
from renderer.scene import compiled as compiled_file
from renderer.settings import RenderSettings, Tile, View
from tests.renderer.builders import emitter, scene, square
from worker import render as slot
from worker.contract import RenderBatch, unpack_sums

SETTINGS = RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0)))
TILE = Tile(0, 0, 8, 8)


@pytest.fixture
def worker(tmp_path: Path) -> Any:
    made = scene([emitter(1.0)], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),))
    compiled_file.save(made, tmp_path / "compiled")
    slot._open.clear()
    return SimpleNamespace(name="w", cache=SimpleNamespace(path=lambda sha256: tmp_path / "compiled"), made=made)


def test_a_slot_says_when_it_gets_a_kernel_ready(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    batch = RenderBatch("b", "job", 0, "sha", TILE, 0, 2, SETTINGS)
    told: list[Any] = []
    monkeypatch.setattr(slot, "is_warm", lambda settings: False)
    monkeypatch.setattr(slot, "warm_up", told.append)
    result = slot.render(worker, batch, told.append)
    assert told == [True, SETTINGS, False]
    assert result.sums is not None
    np.testing.assert_array_equal(unpack_sums(result.sums, TILE), render_batch(worker.made, SETTINGS, TILE, 0, 2).sums)

    told.clear()
    monkeypatch.setattr(slot, "is_warm", is_warm)
    assert slot.render(worker, batch, told.append).sums == result.sums
    assert told == []
