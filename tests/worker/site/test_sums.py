"""Tests of the store of a site's reducer, which collects the sums of a run: consecutive samples of one tile.

The sums are sent once, when the run is complete or after a timeout. If the reducer is killed, its successor sends them.
"""

from __future__ import annotations

import errno
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocol.contract import Result
from protocol.joint import Run
from protocol.sums import pack_sums, unpack_sums
from renderer.film import CHANNELS, SAMPLES
from renderer.settings import Tile
from worker.site.sums import SiteSums, SumsFullError

TILE = Tile(8, 0, 4, 4)
SUMS = np.arange(CHANNELS * 16, dtype="<i8").reshape(CHANNELS, 4, 4)
SUMS[SAMPLES] = 1
HOLD_S = 3.0


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def sums(first: int, count: int, worker: str = "a", of: tuple[int, int] = (0, 12), **more: Any) -> Result:
    about = {"job": "j", "frame": 0, "tile": list(TILE), "first": first, "count": count, "worker": worker, "seconds": 0.5}
    event: dict[str, Any] = {
        "type": "batch",
        "batch": f"b{first}",
        **about,
        "bad": [],
        "bad_count": 0,
        "run": list(Run("attic", *of, HOLD_S)),
    }
    return Result({**event, **more}, pack_sums(SUMS * count))


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def kept(tmp_path: Path, clock: Clock) -> SiteSums:
    return SiteSums(tmp_path, 1 << 20, clock)


def sent_results(kept: SiteSums, at_once: bool = False) -> list[Result]:
    return [result for results in kept.due_results(at_once) for result in results]


def test_run_is_sent_as_one_result_with_worker_names(kept: SiteSums) -> None:
    parts = [["c", 4, 2, 0.25], ["d", 6, 6, 0.5]]
    kept.store(sums(4, 8, "beta", type="batches", parts=parts))
    assert not sent_results(kept)
    assert kept.batches_in_hand() == ["c", "d"]
    kept.store(sums(0, 4, "alpha"))
    (one,) = sent_results(kept)
    assert one.event["parts"] == [["b0", 0, 4, 0.5, "alpha"], ["c", 4, 2, 0.25, "beta"], ["d", 6, 6, 0.5, "beta"]]
    assert (one.event["type"], one.event["first"], one.event["count"], one.event["tile"]) == ("batches", 0, 12, list(TILE))
    assert np.array_equal(unpack_sums(one.sums or b"", TILE), 12 * SUMS)
    assert not sent_results(kept)
    assert not kept.batches_in_hand()
    assert kept.size == 0


def test_unstorable_result_leaves_no_files(kept: SiteSums, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(path: Path, data: bytes) -> int:
        with path.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", half)
        with pytest.raises(OSError, match="No space left"):
            kept.store(sums(0, 4))
    assert not list(tmp_path.iterdir())
    kept.store(sums(0, 12))
    assert len(sent_results(kept)) == 1


def test_sums_are_due_after_hold_time(kept: SiteSums, clock: Clock) -> None:
    kept.store(sums(0, 2))
    kept.store(sums(4, 6))
    clock.now = HOLD_S + 0.1
    assert [(r.event["first"], r.event["count"]) for r in sent_results(kept)] == [(0, 2), (4, 6)], (
        "what does not follow stays apart"
    )
    kept.store(sums(2, 2))
    assert not sent_results(kept)
    kept.store(sums(10, 2))
    assert [r.event["first"] for r in sent_results(kept)] == [2, 10], "now all of the run has come"


def test_duplicate_result_is_sent_once(kept: SiteSums) -> None:
    for _ in range(2):
        kept.store(sums(0, 6))
    with pytest.raises(ValueError, match="another batch"):
        kept.store(sums(5, 2))
    kept.store(sums(6, 6))
    (one,) = sent_results(kept)
    assert [part[0] for part in one.event["parts"]] == ["b0", "b6"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"run": None},
        {"tile": [0, 0, 4, 5]},
        {"run": ["attic", 2, 10, HOLD_S]},
        {"run": ["attic", 0, 12, math.nan]},
        {"run": ["attic", 0, math.inf, HOLD_S]},
        {"tile": [0, 0, 4, math.inf]},
        {"worker": ""},
        {"type": "batch-failed"},
        {"type": "batches", "parts": [["c", 0, 3, 0.5]]},
        {"type": "batches", "parts": 7},
        {"bad": None},
    ],
)
def test_invalid_result_is_rejected(kept: SiteSums, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"."):
        kept.store(sums(0, 4, **wrong))
    assert not kept.batches_in_hand()


def test_deleted_folder_does_not_block_others(kept: SiteSums, tmp_path: Path) -> None:
    kept.store(sums(0, 12))
    kept.store(sums(12, 12, of=(12, 12)))
    sending = kept.due_results()
    next(sending)
    for folder in tmp_path.iterdir():
        shutil.rmtree(folder)
    assert not [*sending]
    assert not kept.batches_in_hand()
    kept.store(sums(24, 12, of=(24, 12)))
    assert len(sent_results(kept)) == 1


def test_sums_with_wrong_sample_count_are_not_merged(kept: SiteSums) -> None:
    result = sums(0, 6)
    with pytest.raises(ValueError, match="a pixel has 6 samples, but the batch has 4"):
        kept.store(Result(sums(0, 4).event, result.sums))


def test_size_limit_is_enforced(tmp_path: Path) -> None:
    kept = SiteSums(tmp_path, 1500, Clock())
    kept.store(sums(0, 2))
    with pytest.raises(SumsFullError):
        kept.store(sums(2, 2))
    assert len(sent_results(kept, at_once=True)) == 1
    kept.store(sums(2, 2))


def test_restart_sends_sums_of_killed_reducer_unchanged(tmp_path: Path, kept: SiteSums) -> None:
    kept.store(sums(0, 12))
    kept.store(sums(12, 2, of=(12, 12)))
    sending = next(kept.due_results())  # killed before it has finished sending
    kept.store(sums(14, 2, of=(12, 12)))
    (tmp_path / "no name of ours").mkdir()
    after = SiteSums(tmp_path, 1 << 20)
    assert sorted(after.batches_in_hand()) == ["b0", "b12", "b14"]
    again, rest = sorted(sent_results(after), key=lambda result: result.event["first"])
    assert [again] == sending
    assert (rest.event["first"], rest.event["count"]) == (12, 4)
    assert not [*tmp_path.iterdir()]
