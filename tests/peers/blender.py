"""Finds a Python with Blender, and runs scripts with it that write files."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from renderer.blender.program import NAMED
from tests.helpers import ROOT

__all__ = ["TO_Y_UP", "python_with_bpy", "written_by"]

TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def python_with_bpy() -> Path | None:
    """Returns a Python that has bpy, which needs a different NumPy than ours; None if there is none."""
    named = os.environ.get("RAYFARM_BPY_PYTHON")
    python = Path(named) if named else ROOT / ".venv-cycles" / "bin" / "python"
    return python if python.exists() else None


@contextmanager
def written_by(script: str, folder: Path) -> Iterator[Path]:
    """Runs a script of this package in Blender, and yields the folder into which it wrote.

    Inside the `with` block our .blend reader uses the same Blender. Skips the test if there is no Blender.
    """
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    done = subprocess.run([python, Path(__file__).with_name(script), folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(NAMED, str(python))
        yield folder
