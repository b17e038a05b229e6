"""Tests of a real worker process that renders with a graphics card, which a program on the CPU simulates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from protocol.card import RENDER_ON_CARD, CardBatches, card_queue
from protocol.contract import RenderBatch, SceneInfo
from protocol.sums import unpack_sums
from renderer.cuda.verdicts import START_KERNELS
from renderer.render import render_batch
from renderer.scene import compiled as compiled_file
from renderer.settings import RenderSettings, View, tiles_of
from tests.helpers import wait_until
from tests.renderer.cuda.on_host import fake_driver, shared_objects
from tests.worker.bench import a_worker

SCENE = """
shapes:
  - {type: sphere, name: ball, center: [0, 0, 0], radius: 1, material: grey}
materials:
  grey: {kind: diffuse, color: 0.5}
environment: {color: 1}
"""


@pytest.mark.long
def test_card_result_equals_cpu_result(redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_driver(tmp_path)
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    monkeypatch.setenv("FAKE_CUDA_CARDS", "RTX Test:8:6:8192,GTX Test:6:1:4096")
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_objects(START_KERNELS, tmp_path / "kernels")))
    (tmp_path / "worker").mkdir()
    with a_worker(redis_url, tmp_path / "worker", slots=2, options=("--gpu=only",)) as bench:
        report = bench.report()
        assert report is not None
        assert (report.slots, report.has_card_queue) == (1, True)
        assert [card["name"] for card in report.cards] == ["RTX Test"]
        assert "GTX Test" in report.cards_unused[0]
        bench.upload("ball", {"ball.yaml": SCENE.encode()}, "ball.yaml")
        info = SceneInfo.from_json(bench.prepare("ball").event["info"])
        settings = RenderSettings(48, 32, View((0, 0, 4), (0, 0, 0)))
        tiles = tiles_of(48, 32, 16)
        parts = [RenderBatch(f"b{k}", "job", 0, info.compiled.sha256, tile, 2, 3, settings) for k, tile in enumerate(tiles)]
        work = CardBatches(tuple(parts))
        bench.celery.send_task(RENDER_ON_CARD, kwargs={"card": work.to_json()}, queue=card_queue(report.name), task_id="b0")
        found = {}
        while len(found) < len(tiles):
            result = bench.next("batch", seconds=300)
            found[result.event["batch"]] = result
        for name, data in bench.service.blobs.items():
            (tmp_path / name).write_bytes(data)
        scene = compiled_file.load(tmp_path / info.compiled.sha256)
        for part in parts:
            sums = unpack_sums(found[part.batch].sums, part.tile)
            assert np.array_equal(sums, render_batch(scene, settings, part.tile, 2, 3).sums)
        wait_until(lambda: bench.report().cards[0]["samples_per_s"] > 0, 30, "the card's rate is reported")  # type: ignore[union-attr]
