"""Tests of slots of a real worker that share a tile: sums equal those of a single slot, each sample once, even after kills."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from protocol.contract import RenderBatch, Result, SceneInfo, render_queue
from protocol.joint import RENDER_JOINTLY, JointBatch, Piece
from protocol.sums import PACKED, pack_sums, unpack_sums
from renderer.settings import RenderSettings, Tile, View
from tests.helpers import wait_until
from tests.worker.bench import Bench, a_worker, processor_times, rendering_slot, slots_of
from tests.worker.test_worker import SCENE
from worker.site.merging import merged_results

TILE = Tile(0, 0, 64, 64)


@pytest.fixture(scope="module")
def bench(redis_url: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with a_worker(redis_url, tmp_path_factory.mktemp("jointly"), slots=3) as made:
        yield made


@pytest.fixture(scope="module")
def info(bench: Bench) -> SceneInfo:
    return prepared(bench)


def prepared(bench: Bench) -> SceneInfo:
    bench.upload("ball", {"ball.yaml": SCENE.encode()}, "ball.yaml")
    return SceneInfo.from_json(bench.prepare("ball").event["info"])


def joint(info: SceneInfo, message: str, counts: list[int], hold_s: float = 60.0) -> JointBatch:
    settings = RenderSettings(64, 64, View((0, 0, 4), (0, 0, 0)))
    whole = RenderBatch(message, message, 0, info.compiled.sha256, TILE, 0, sum(counts), settings, PACKED)
    pieces = tuple(Piece(f"{message}-{i}", sum(counts[:i]), count) for i, count in enumerate(counts))
    return JointBatch(whole, pieces, hold_s)


def hand_out(bench: Bench, work: JointBatch) -> None:
    queue, id = render_queue(bench.report().kind), work.whole.batch  # type: ignore[union-attr]
    bench.celery.send_task(RENDER_JOINTLY, kwargs={"joint": work.to_json()}, queue=queue, task_id=id, ignore_result=True)


def ranges(results: list[Result]) -> list[tuple[int, int]]:
    return sorted((each.event["first"], each.event["count"]) for each in results)


@pytest.mark.long
def test_slots_send_one_bit_exact_result(bench: Bench, info: SceneInfo) -> None:
    bench.render(joint(info, "alone", [12]).whole)
    alone = bench.next("batch", "batch-failed")
    hand_out(bench, joint(info, "three", [2, 3, 7]))
    together = bench.next("batches", "batch", "batch-failed")
    event = together.event
    assert (event["type"], event["first"], event["count"], event["job"]) == ("batches", 0, 12, "three"), event
    assert [part[:3] for part in event["parts"]] == [["three-0", 0, 2], ["three-1", 2, 3], ["three-2", 5, 7]]
    assert all(part[3] > 0 for part in event["parts"])
    assert event["worker"] == bench.report().name  # type: ignore[union-attr]
    assert np.array_equal(unpack_sums(together.sums or b"", TILE), unpack_sums(alone.sums or b"", TILE))
    wait_until(lambda: not bench.report().in_hand, 20, "nothing is left")  # type: ignore[union-attr]


@pytest.mark.long
def test_surplus_pieces_are_requeued(bench: Bench, info: SceneInfo) -> None:
    hand_out(bench, joint(info, "many", [1] * 8))
    found: list[Result] = []
    while sum(each.event["count"] for each in found) < 8:
        found.append(bench.next("batches", "batch", "batch-failed"))
    assert [end for end, _ in ranges(found)] == [0, 3, 6], "three at a time"


@pytest.mark.long
def test_killed_slot_loses_only_its_piece(bench: Bench, info: SceneInfo) -> None:
    long = 3500
    before = processor_times(bench.process.pid)
    hand_out(bench, joint(info, "killed", [4, long, 4]))
    wait_until(lambda: _has(bench, long), 30, "a slot renders the long piece")
    assert bench.report().in_hand == ["killed"]  # type: ignore[union-attr]
    wait_until(lambda: sum(map(bool, bench.report().current)) == 1, 30, "the others have ended")  # type: ignore[union-attr]
    rendering_slot(before).kill()
    found = [bench.next("batches", "batch", "batch-failed") for _ in range(2)]
    assert ranges(found) == [(0, 4), (4 + long, 4)], "its message may come again: then it is rendered once more, by itself"


@pytest.mark.long
def test_fetched_joint_batch_is_reported_before_a_slot_begins_it(bench: Bench, info: SceneInfo) -> None:
    wait_until(lambda: len(slots_of(bench.process.pid)) == 3, 30, "the slot that was killed has a successor")
    slots = slots_of(bench.process.pid)
    for slot in slots:  # as on an overloaded machine
        slot.suspend()
    try:
        bench.render(replace(joint(info, "alone", [3]).whole, batch="taken"), "taken")
        wait_until(lambda: "taken" in bench.report().in_hand, 30, "it says so")  # type: ignore[union-attr]
    finally:
        for slot in slots:
            slot.resume()
    while (event := bench.next("batch", "batch-failed").event)["batch"] != "taken":
        pass  # the long piece again
    assert (event["type"], event["count"]) == ("batch", 3)
    wait_until(lambda: "taken" not in bench.report().in_hand, 30, "it is done")  # type: ignore[union-attr]


@pytest.mark.long
def test_stopping_worker_sends_sums_and_requeues_pieces(redis_url: str, tmp_path: Path, bench: Bench) -> None:
    with a_worker(redis_url, tmp_path, slots=2) as ending:
        bench.store.set("rayfarm:order:" + bench.report().name, "The other is asked.")  # type: ignore[union-attr]
        try:
            wait_until(lambda: bench.report().state == "paused", 20, "it takes nothing")  # type: ignore[union-attr]
            hand_out(ending, joint(prepared(ending), "ending", [900, 901, 902, 903]))
            wait_until(lambda: any(_has(ending, count) for count in range(900, 904)), 20, "it is at work")
            ending.process.terminate()
            assert ending.process.wait(60) == 0
        finally:
            bench.store.delete("rayfarm:order:" + bench.report().name)  # type: ignore[union-attr]
    found: list[Result] = []
    while sum(each.event["count"] for each in found) < 3606:
        result = bench.next("batches", "batch", "batch-failed")
        found += [result] if result.event["job"] == "ending" else []
    covered = 0
    for first, count in ranges(found):
        assert first == covered, "each sample once"
        covered += count


def _has(bench: Bench, count: int) -> bool:
    report = bench.report()
    return report is not None and any(doing.get("count") == count for doing in report.current)


def test_only_consecutive_samples_are_merged() -> None:
    sums = np.arange(20 * 4, dtype="<i8").reshape(20, 2, 2)
    about = {"type": "batch", "job": "j", "frame": 0, "tile": [0, 0, 2, 2], "worker": "w", "seconds": 0.5, "bad_count": 1}

    def one(first: int, count: int) -> Result:
        return Result({**about, "batch": f"b{first}", "first": first, "count": count, "bad": [[0, 0, first]]}, pack_sums(sums))

    run, alone = merged_results([one(0, 2), one(2, 3), one(9, 1)])
    assert json.loads(json.dumps(run.event)) == {
        **{key: about[key] for key in ("job", "frame", "tile", "worker")},
        "type": "batches",
        "first": 0,
        "count": 5,
        "bad": [[0, 0, 0], [0, 0, 2]],
        "bad_count": 2,
        "parts": [["b0", 0, 2, 0.5], ["b2", 2, 3, 0.5]],
    }
    assert np.array_equal(unpack_sums(run.sums or b"", Tile(0, 0, 2, 2)), 2 * sums)
    assert alone.event["batch"] == "b9"
