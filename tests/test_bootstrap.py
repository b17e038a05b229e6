"""Tests of farm.py, the file that installs and starts a farm, and of the versions that it installs."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.helpers import ROOT


def pins() -> dict[str, str]:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.!+_-]+", line) for line in lines), "names and versions only"
    return {normal(name): version for name, _, version in (line.partition("==") for line in lines)}


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + [d for extra in project["optional-dependencies"].values() for d in extra]
    names = {normal(re.match(r"[A-Za-z0-9._-]+", dependency).group()) for dependency in wanted}  # type: ignore[union-attr]
    assert names <= pins().keys(), names - pins().keys()


def test_missing_command_lists_the_commands() -> None:
    done = subprocess.run([sys.executable, ROOT / "farm.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "python3 farm.py up" in done.stdout


def test_help_installs_nothing(tmp_path: Path) -> None:
    shutil.copy(ROOT / "farm.py", tmp_path)
    done = subprocess.run([sys.executable, tmp_path / "farm.py", "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "python3 farm.py up" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["farm.py"]


def test_unknown_install_argument_installs_nothing(tmp_path: Path) -> None:
    shutil.copy(ROOT / "farm.py", tmp_path)
    command = [sys.executable, tmp_path / "farm.py", "install", "--kernels"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "install takes --no-kernels or --all-kernels, not --kernels" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["farm.py"]


def test_outdated_python_gets_an_error_message() -> None:
    """Run by a Python that is too old, farm.py prints an error instead of a syntax error, if it finds no newer Python."""
    source = (ROOT / "farm.py").read_text()
    ast.parse(source, feature_version=(3, 6))
    older = "import runpy, sys; sys.version_info = (3, 9, 2); sys.argv = ['farm.py', 'up']"
    program = f"{older}; runpy.run_path('farm.py', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, env={"PATH": "/nonexistent"}, check=False
    )
    assert done.returncode == 1
    assert "This is Python 3.9; Rayfarm needs Python 3.11, 3.12 or 3.13" in done.stderr


def _farm() -> Any:
    specification = importlib.util.spec_from_file_location("farm", ROOT / "farm.py")
    assert specification is not None
    assert specification.loader is not None
    farm = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(farm)
    return farm


def test_benchmark_receives_its_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arguments after the names of benchmarks are passed on to them. An unknown first name is an error."""
    farm = _farm()
    commands: list[list[str]] = []
    monkeypatch.setattr(farm, "install", lambda extras: sys.executable)
    monkeypatch.setattr(subprocess, "call", lambda command, **options: commands.append(command) or 0)
    assert farm.run_benchmarks(["first_picture", "a.glb", "--rounds", "1"]) == 0
    assert [command[2:] for command in commands] == [["a.glb", "--rounds", "1"]]
    with pytest.raises(SystemExit):
        farm.run_benchmarks(["first_pitcure", "a.glb"])


@pytest.mark.parametrize(("codes", "expected"), (([3], 3), ([0], 0), ([0, 3], 1)))
def test_benchmark_keeps_its_exit_code(codes: list[int], expected: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One benchmark's exit code is passed on, as 3 of `gpu` while steps are left; several end with 1 if any of them failed."""
    farm = _farm()
    left = [*codes]
    monkeypatch.setattr(farm, "install", lambda extras: sys.executable)
    monkeypatch.setattr(subprocess, "call", lambda command, **options: left.pop(0))
    assert farm.run_benchmarks(["gpu", "drafts"][: len(codes)]) == expected
    assert not left


@pytest.mark.long
def test_skips_are_failures_in_ci(tmp_path: Path) -> None:
    skips = "def test_{}(monkeypatch):\n    monkeypatch.setenv('CI', '{}')\n    pytest.skip('no Chromium')\n"
    (tmp_path / "test_page.py").write_text("import pytest\n\n" + skips.format("here", "") + skips.format("there", "true"))
    (tmp_path / "test_processor.py").write_text("import pytest\n\n@pytest.mark.hardware\n" + skips.format("elsewhere", "true"))
    (tmp_path / "test_reader.py").write_text("import pytest\n\npytest.importorskip('no_library')\n")
    options = ["-p", "tests.conftest", "--rootdir", str(tmp_path), "--continue-on-collection-errors", str(tmp_path)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_XDIST_")}
    environment |= {"CI": "true", "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    assert re.search(r"1 failed, 2 skipped, .*1 error\b", done.stdout), done.stdout + done.stderr
    assert "test_page.py::test_there must not be skipped where $CI is set: Skipped: no Chromium" in done.stdout
    assert "test_reader.py must not be skipped where $CI is set: Skipped: could not import 'no_library'" in done.stdout
