"""Tests of the campaign of damaged files: which files are drawn, and how outcomes are classified."""

import io
import os
import random
import signal
import zipfile

import pytest

from tests.benchmarks import bench_mutations
from tests.benchmarks.mutations.damage import WAYS, damaged
from tests.benchmarks.mutations.reading import read_all
from tests.benchmarks.mutations.seed import Seed, draw, kind_of
from tests.benchmarks.mutations.tally import OUTCOMES, Tally, into_page, table
from tests.bounded import Bounds
from tests.grids import grid

TEXT = b"v 1.5 2 3\nv 4 5 6\nf 1 2 3\n" * 20


@pytest.mark.parametrize("way", WAYS)
def test_damage_changes_the_data_and_depends_on_the_seed_only(way):
    found = [WAYS[way](data, random.Random(seed)) for data in (TEXT, bytes(range(256))) for seed in range(8)]
    assert sum(each not in (TEXT, bytes(range(256))) for each in found) >= 12
    assert found == [WAYS[way](data, random.Random(seed)) for data in (TEXT, bytes(range(256))) for seed in range(8)]


def test_tiny_and_empty_files_can_be_damaged():
    for seed in range(100):
        for data in (b"", b"x"):
            assert isinstance(damaged(data, random.Random(seed))[0], bytes)


def test_each_campaign_number_is_drawn_independently():
    seeds = {"one": [Seed("a.obj", {"a.obj": TEXT, "b.mtl": b"newmtl a"})], "other": [Seed("c.ply", {"c.ply": TEXT})]}
    assert draw(7, 1, seeds) == draw(7, 1, seeds)
    assert len({draw(i, 1, seeds)[0] for i in range(20)}) == 2
    assert all(draw(i, 1, seeds)[0] == kind_of(i, 1, seeds) for i in range(20))


def test_package_members_are_damaged_before_packing():
    seeds = {"a": [Seed("a.3mf", {"x": TEXT, "y": b"1"}, ("x",), is_package=True)]}
    drawn = [draw(i, 1, seeds) for i in range(20)]
    inside = [zipfile.ZipFile(io.BytesIO(files["a.3mf"])) for _, _, files, _ in drawn]
    assert sum(each.read("x") != TEXT for each in inside) > 10


def lost(number, _):
    """Reading function of a simulated campaign: for three of the numbers it kills its process, hangs, or raises SystemError."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 5:
        signal.pause()
    if number == 7:
        raise SystemError
    return {"twice": 2 * number}


@pytest.mark.long
def test_lost_child_process_loses_one_file_only():
    found = {came.number: came.answer for came in read_all(range(10), lost, Bounds(1 << 30, 4.0), 2)}
    assert found == {number: None if number in (3, 5, 7) else {"twice": 2 * number} for number in range(10)}


@pytest.mark.long
@grid(
    ("ends", "outcome"),
    [
        (lambda *_: {"outcome": "read"}, "read"),
        (lambda *_: os.kill(os.getpid(), signal.SIGKILL), "child crashed"),
        (lambda *_: bytearray(1 << 33), "too large"),
        (lambda *_: {}[0], "refused by the net"),
        (lambda *_: signal.pause(), "too slow"),
    ],
)
def test_child_outcome_is_classified(ends, outcome, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(bench_mutations, "read", ends)
    monkeypatch.setattr(bench_mutations, "SECONDS", 1.0 if outcome == "too slow" else 60.0)
    found = bench_mutations.outcome(tmp_path, "a.obj")
    assert found["outcome"] == outcome in OUTCOMES


def test_table_totals_are_correct(tmp_path):
    found = {"a": Tally(), "b": Tally()}
    for i in range(5):
        found["a" if i % 2 else "b"].add(OUTCOMES[i], 0.5 * i, i << 20)
    rows = table(found).splitlines()
    assert rows[-1] == "| **all** | 5 | 1 | 1 | 1 | 1 | 1 | 0 | 2.0 s | 4 MiB |"
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- mutations: made by `farm.py bench mutations` -->\nold\n<!-- end of mutations -->\nafter\n")
    into_page(page, "NEW")
    assert "NEW" in page.read_text()
    assert "old" not in page.read_text()
    assert page.read_text().endswith("after\n")
