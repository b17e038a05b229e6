"""Tests that every benchmark has a help text, and that `--help` runs nothing."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from tests.grids import grid
from tests.helpers import ROOT

BENCHMARKS = sorted(path.stem for path in (ROOT / "tests" / "benchmarks").glob("bench_*.py"))


@grid("name", BENCHMARKS)
def test_benchmark_prints_help(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    module = importlib.import_module(f"tests.benchmarks.{name}")
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        module.main()
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: ")


@pytest.mark.parametrize(("option", "code"), [("--help", 0), ("--quick", 2)])
def test_missing_benchmark_name_lists_the_benchmarks(option: str, code: int) -> None:
    command = [sys.executable, str(ROOT / "farm.py"), "bench", option]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == code, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[2:]] == [name.removeprefix("bench_") for name in BENCHMARKS]
