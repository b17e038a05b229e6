"""Tests of the comparison with other renderers: its verdicts, and a small run of every row."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import farm
from tests.benchmarks.peers.measure import Line, Taken, geometric_mean, race, ratio_line, relative_error
from tests.benchmarks.peers.meshes import displaced_sphere, torus
from tests.benchmarks.peers.references import References
from tests.benchmarks.peers.report import Report
from tests.benchmarks.peers.sizes import QUICK, Sizes
from tests.benchmarks.peers.surroundings import find_llvm
from tests.benchmarks.peers.targets import TABLE
from tests.helpers import ROOT

BENCH = ROOT / "tests" / "benchmarks" / "bench_peers.py"


def run_bench(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BENCH), f"--out={out}", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_rounds_alternate_between_both_sides() -> None:
    order = []

    def side(name: str, seconds: float) -> object:
        def one(number: int) -> Taken:
            order.append((name, number))
            return Taken(seconds, seconds)

        return one

    run = race(side("we", 1.0), side("they", 3.0), 3)
    assert order == [("we", 0), ("they", 0), ("they", 1), ("we", 1), ("we", 2), ("they", 2)]
    assert run.ratios == [3.0, 3.0, 3.0]
    assert run.cpu_ratio == 3.0


def test_single_thread_rows_compare_processor_time() -> None:
    run = race(lambda _: Taken(9.0, 1.0), lambda _: Taken(1.0, 2.0), 1, clock="cpu")
    assert run.ratios == [2.0]


def test_error_is_relative_and_ignores_fireflies() -> None:
    truth = np.full((100, 100, 3), 2.0)
    picture = truth * 1.1
    expected = 0.04 / (4 + 0.04)
    assert relative_error(picture, truth) == pytest.approx(expected)
    picture[0, :10] = 1e6  # 1/1000 of the pixels
    assert relative_error(picture, truth) == pytest.approx(expected)
    picture[1, 0] = 1e6
    assert relative_error(picture, truth) > 1e6


def line(row: str, name: str, value: float) -> Line:
    return ratio_line(row, name, [value], "", [value], [1.0])


def test_report_lists_missed_targets() -> None:
    report = Report({}, quick=False)
    names = ["Cornell box", "textured mesh", "many lights"]
    report.lines = [line("error-time", name, value) for name, value in zip(names, (1.2, 2.0, 7.0), strict=True)]
    report.missing["rays"] = "Embree is away"
    verdicts = {v.name: v for v in report.verdicts()}
    assert {name: v.met for name, v in verdicts.items()} == {
        "Cornell box": False,  # the target is 1.3
        "textured mesh": True,
        "many lights": False,  # the target is 8, and the line is not part of the mean
        "geometric mean": False,
    }
    assert verdicts["geometric mean"].value == pytest.approx(geometric_mean([1.2, 2.0]))
    text = report.text()
    assert "error-time, many lights: 7, at least 8 is asked for" in text
    assert "1 of 4 reached" in text
    assert "not measured: rays: Embree is away" in text


def test_converged_picture_is_cached(tmp_path: Path) -> None:
    made = []

    def picture(spp: int, seed: int) -> np.ndarray:
        made.append((spp, seed))
        return np.full((2, 2, 3), float(seed))

    few, more = replace(QUICK, reference_spp=512), replace(QUICK, reference_spp=1024)
    first = References(few, tmp_path).of("a case, lit", "mitsuba 3", picture)
    assert made == [(256, 1000), (256, 1001)]
    np.testing.assert_array_equal(first, 1000.5)
    np.testing.assert_array_equal(References(few, tmp_path).of("a case, lit", "mitsuba 3", picture), first)
    assert len(made) == 2
    for sizes, case, side in (
        (more, "a case, lit", "mitsuba 3"),
        (few, "another", "mitsuba 3"),
        (few, "a case, lit", "mitsuba 4"),
    ):
        count = len(made)
        References(sizes, tmp_path).of(case, side, picture)
        assert len(made) > count


@pytest.mark.parametrize("make", [displaced_sphere, torus])
@pytest.mark.parametrize("count", [5_000, 70_000])
def test_generated_meshes_have_the_requested_size_and_outward_normals(make, count) -> None:
    mesh = make(count)
    assert len(mesh.triangles) == pytest.approx(count, rel=0.05)
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(float) for k in range(3))
    face = np.cross(b - a, c - a)
    assert (np.linalg.norm(face, axis=1) > 0).all()
    assert np.einsum("ij,ij->", face, a) / 6 > 0.1, "turned inside out: the volume is below zero"
    shading = mesh.normals[mesh.triangles].sum(1)
    assert (np.einsum("ij,ij->i", face, shading) > 0).mean() > 0.999
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


def test_unknown_row_is_an_error_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench_peers", f"--out={tmp_path}", "--rows=samples,speed"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module("tests.benchmarks.bench_peers").main()
    assert ended.value.code == 2
    assert "there is no row speed; known are samples, error, cycles" in capsys.readouterr().err


def test_selected_lines_are_measured_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only the selected lines are measured. A selection may be a name with commas, or a beginning that several lines share."""
    bench = importlib.import_module("tests.benchmarks.bench_peers")
    asked: list[str] = []

    def lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
        for name in ("Cornell box", "large mesh, diffuse", "large mesh, rough plastic", "textured mesh"):
            if sizes.wants(name):
                asked.append(name)
                yield line("samples", name, 2.0)

    monkeypatch.setattr(bench, "ROWS", {"samples": lines})
    monkeypatch.setattr(bench, "warm_up", lambda: None)
    monkeypatch.setattr(bench.Report, "_plot", lambda *_: None)  # matplotlib is installed only for benchmarks
    for only, found, code in (
        ("large mesh, rough plastic,textured mesh", ["large mesh, rough plastic", "textured mesh"], 0),
        ("large mesh", ["large mesh, diffuse", "large mesh, rough plastic"], 0),
        ("Cornell box,cornflakes", ["Cornell box"], 1),
    ):
        asked.clear()
        monkeypatch.setattr(sys, "argv", ["peers", f"--only={only}", f"--out={tmp_path}"])
        assert bench.main() == code
        assert asked == found
        assert "geometric mean " not in (tmp_path / "peers.txt").read_text()
    assert "No line of these rows is called cornflakes." in capsys.readouterr().err


def test_lines_measured_together_are_selected_by_either_name() -> None:
    sizes = replace(QUICK, only=("a.glb, seconds",))
    assert sizes.wants("a.glb")
    assert not sizes.wants("a.ply")
    assert repr(sizes) == repr(QUICK), "converged pictures are kept by their sizes"


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_every_row_runs_with_small_sizes(tmp_path: Path) -> None:
    """A run with small sizes and one round yields every line of the table; the measured figures are not checked."""
    if find_llvm() is None and not farm.may_install():
        pytest.skip("Mitsuba needs LLVM 16 or newer")
    if shutil.which("python3.11") is None and "RAYFARM_BPY_PYTHON" not in os.environ:
        pytest.skip("Blender's module needs Python 3.11")
    done = run_bench(tmp_path, "--quick")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    data = json.loads((tmp_path / "peers.json").read_text())
    assert data["missing"] == {}
    lines = {row: {line["name"]: line for line in data["lines"] if line["row"] == row} for row in TABLE if row != "against"}
    assert {row: len(found) for row, found in lines.items()} == {
        "samples": 6,
        "error-time": 5,
        "error-samples": 5,
        "cycles": 2,
        "rays": 10,
        "build": 1,
        "ready": 2,
        "formats": 18,
        "threads": 3,
        "cold": 2,
        "scaling": 5,
    }
    assert all(line["value"] > 0 for found in lines.values() for line in found.values())
    for name, found in lines["error-samples"].items():
        notes = found["notes"]
        assert notes["our_mean"] == pytest.approx(notes["peer_mean"], rel=0.05), f"{name}: the two do not show the same scene"
    assert {path.stem for path in tmp_path.glob("*.png")} == set(TABLE) - {"against"}
    assert "Quick" in (tmp_path / "peers.txt").read_text()
