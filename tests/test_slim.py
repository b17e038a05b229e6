"""Tests of deploy/images/slim.py, which removes unused files of libraries from a container image.

The tests run it on copies of a few libraries of this installation.
"""

from __future__ import annotations

import importlib.util
import runpy
import shutil
from pathlib import Path

import pytest

from tests.helpers import ROOT

LIBRARY = "_dispatcher"  # one of Numba's libraries, most of which is symbols


def library(package: str, pattern: str) -> Path:
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.origin is not None
    return next(iter(sorted(Path(spec.origin).parent.glob(pattern))))


@pytest.fixture
def venv(tmp_path: Path) -> Path:
    """Returns the folder of a simulated virtual environment that has both needed and removable files."""
    packages = tmp_path / "lib" / "python3.12" / "site-packages"
    for name in (
        "pip/main.py",
        "numba/__init__.py",
        "numba/tests/test_it.py",
        "numba/cuda/api.py",
        "celery/bin/amqp.py",
        "pxr/UsdVol/__init__.py",
        "pxr/UsdGeom/__init__.py",
        "kept/module.py",
        "kept/module.pyi",
    ):
        file = packages / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("x = 1\n")
    (tmp_path / "bin").mkdir()
    for name in ("python3", "python3.12", "pip3", "draco_encoder"):
        (tmp_path / "bin" / name).touch()
    return tmp_path


def slim(venv: Path) -> Path:
    """Runs slim.py on the simulated virtual environment, and returns the environment's folder of packages."""
    runpy.run_path(str(ROOT / "deploy" / "images" / "slim.py"))["main"](str(venv))
    return venv / "lib" / "python3.12" / "site-packages"


def test_unused_files_are_removed(venv: Path) -> None:
    packages = slim(venv)
    left = sorted(str(path.relative_to(packages)) for path in packages.rglob("*") if path.is_file())
    assert left == ["kept/module.py", "numba/__init__.py", "pxr/UsdGeom/__init__.py"]
    assert sorted(path.name for path in (venv / "bin").iterdir()) == ["python3", "python3.12"]


@pytest.mark.skipif(shutil.which("strip") is None, reason="needs strip (Debian: apt-get install binutils)")
def test_stripped_libraries_still_load(venv: Path) -> None:
    packages = venv / "lib" / "python3.12" / "site-packages"
    folder = packages / "kept"
    whole = library("numba", f"{LIBRARY}.*.so")
    shutil.copy(whole, folder / "one.so")
    shutil.copy(whole, folder / "one.so.1")
    # auditwheel moved these files' segments, after which `strip` makes them unloadable.
    moved = [path for name in ("libgfortran", "libquadmath") for path in library("numpy", "../numpy.libs").glob(f"{name}*")]
    for path in moved:
        shutil.copy(path, folder)
    before = {path.name: path.stat().st_size for path in folder.glob("*.so*")}
    slim(venv)
    load = runpy.run_path(str(ROOT / "deploy" / "images" / "slim.py"))["_load"]
    assert (folder / "one.so").is_symlink()
    assert (folder / "one.so.1").stat().st_size < before["one.so.1"] - 100_000
    assert load(folder / "one.so.1") == load(whole)
    assert [load(folder / path.name) for path in moved] == [load(path) for path in moved]
    assert not list(folder.glob("*.original"))
