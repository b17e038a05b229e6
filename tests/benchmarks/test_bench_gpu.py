"""Tests of the benchmark of graphics cards: it continues where it ended, and its table has the ratios."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.cuda.cards import Cards
from tests.benchmarks import bench_gpu
from tests.benchmarks.bench_gpu import UNFINISHED, MissingError, Results, Step, _error, _print_table, _run_jobs


def raising(error: BaseException) -> Any:
    def run() -> None:
        raise error

    return run


def test_steps_are_continued(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A step that ended is not run again, nor one in which the process died or failed; one whose library was missing is."""
    results = Results(tmp_path, again=False)
    results.run(Step("speed", "a", lambda: {"rate": 2.0}))
    results.run(Step("speed", "b", raising(ValueError("no such scene"))))
    results.run(Step("mitsuba", "a", raising(MissingError("not installed"))))
    with pytest.raises(KeyboardInterrupt):
        results.run(Step("speed", "c", raising(KeyboardInterrupt())))
    assert "speed: b: ValueError: no such scene (" in capsys.readouterr().out
    with (tmp_path / "results.jsonl").open("a") as file:
        file.write('{"step": "spe')  # the disk was full
    again = Results(tmp_path, again=False)
    assert again.values == {"speed: a": {"rate": 2.0}}
    assert again.failures == {"speed: b": "ValueError: no such scene", "speed: c": "the process ended"}
    for name in "abc":
        again.run(Step("speed", name, raising(AssertionError("run again"))))
    again.run(Step("mitsuba", "a", lambda: {"rate": 1.0}))
    assert again.of("mitsuba") == {"a": {"rate": 1.0}}
    last = Results(tmp_path, again=True)
    last.run(Step("speed", "c", lambda: {"rate": 3.0}))
    assert last.values["speed: c"] == {"rate": 3.0}
    assert last.failures == {}


def test_jobs_are_continued(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A job that ended is kept; one that failed is reported, and one for which there was no time is left for the next run."""
    monkeypatch.setattr(bench_gpu, "cores", lambda: 1)
    ran: list[str] = []

    def process(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        ran.append(command[-1])
        if command[-1] == "load:slow":
            raise subprocess.TimeoutExpired(command, options["timeout"])
        failed = command[-1] == "load:broken"
        return subprocess.CompletedProcess(command, int(failed), "", "Traceback\nCardError: it failed\n" if failed else "")

    monkeypatch.setattr(subprocess, "run", process)
    results = Results(tmp_path, again=False)
    jobs = ["load:plain", "load:broken", "load:slow"]
    assert not _run_jobs(jobs, time.monotonic() + 60, "libcuda.so", results)
    assert ran == jobs
    assert "load:broken: 0 s: failed: CardError: it failed" in capsys.readouterr().out
    assert [*Results(tmp_path, again=False).of("load")] == ["plain"]
    assert not _run_jobs(["load:full"], time.monotonic())
    assert ran == jobs
    assert _run_jobs(["load:full"], time.monotonic() + 60)


def test_only_the_stage_build_runs_without_a_card(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    built: list[str] = []

    def run(jobs: list[str], deadline: float) -> bool:
        built.extend(jobs)
        return "cores:media" not in jobs

    monkeypatch.setattr(bench_gpu, "_run_jobs", run)
    monkeypatch.setattr(bench_gpu, "_is_built", lambda where, kernel: where == "card" and kernel == "plain")
    monkeypatch.setattr(bench_gpu, "find_cards", lambda library: Cards([], ["No graphics card is used: a reason."]))
    for options, code, jobs in (
        (["--kernels=plain,full"], 0, []),
        (["--kernels=plain,full", "--stages=build"], 0, ["card:full", "cores:plain", "cores:full"]),
        (["--kernels=media", "--stages=build"], UNFINISHED, ["card:media", "cores:media"]),
    ):
        built.clear()
        monkeypatch.setattr(sys, "argv", ["bench_gpu.py", *options])
        assert bench_gpu.main() == code
        assert built == jobs
        assert ("a reason" in capsys.readouterr().out) == (not jobs)


def test_jobs_on_a_small_card_share_its_memory(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(bench_gpu, "cores", lambda: 16)
    monkeypatch.setattr(bench_gpu, "available_memory", lambda: 64 << 30)
    for memory, count in ((4 << 30, 4), (100, 1), (80 << 30, 16)):
        assert not _run_jobs(["load:plain"], time.monotonic(), "libcuda.so", None, memory)
        assert f" {count} at a time" in capsys.readouterr().out


def test_table_has_ratios_and_their_means(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = {
        "speed: box, 512x512x64": {"rate": 300.0, "first": 4.0},
        "speed: box, 512x512x256": {"rate": 480.0, "first": 1.0},
        "mitsuba: box, 512x512x64": {"rate": 200.0, "first": 2.0},
        "mitsuba: box, 512x512x256": {"rate": 80.0, "first": 2.0},
        "cores: box, 512x512x16": {"rate": 10.0, "first": 1.0},
        "profile: box": {"trace_rays": 3.5, "end_paths": 1.5},
        "error: Cornell box, card": {"error": 0.01, "seconds": 2.0},
        "error: Cornell box, Mitsuba": {"error": 0.02, "seconds": 3.0},
        "error: textured mesh, card": {"error": 0.01, "seconds": 1.0},
    }
    lines = [json.dumps({"step": step, "value": value}) for step, value in entries.items()]
    (tmp_path / "results.jsonl").write_text("\n".join(lines) + "\n")
    _print_table(Results(tmp_path, again=False))
    said = [line.split() for line in capsys.readouterr().out.splitlines() if line]
    assert said[1][-6:] == ["300.00", "200.00", "1.50", "10.00", "30.00", "4.00"]
    assert said[2][-6:] == ["480.00", "80.00", "6.00", "10.00", "48.00", "1.00"]
    assert said[3] == ["geometric", "mean", "3.00", "37.95"]
    assert " ".join(said[4]) == "error: Cornell box 2.00 for as many samples, 3.00 in the same time"
    assert said[5] == [
        "error:",
        "geometric",
        "mean",
        "2.00",
        "for",
        "as",
        "many",
        "samples,",
        "3.00",
        "in",
        "the",
        "same",
        "time",
    ]
    assert said[6] == ["profile:", "box:", "trace_rays", "3.5,", "end_paths", "1.5"]


def test_error_is_the_relative_variance_of_pictures() -> None:
    def render(seed: int) -> np.ndarray:
        return 2 + 0.1 * np.random.default_rng(seed).standard_normal((200, 200, 3))

    found = _error(render, lambda picture: picture)
    assert found["error"] == pytest.approx(0.01 / 4, rel=0.03)
    assert found["seconds"] > 0
