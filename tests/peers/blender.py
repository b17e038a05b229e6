"""Where Blender is."""

from __future__ import annotations

import os
from pathlib import Path

from tests.helpers import ROOT

__all__ = ["python_with_bpy"]


def python_with_bpy() -> Path | None:
    """A Python that has bpy, which wants another numpy than ours; None where there is none."""
    named = os.environ.get("RAYFARM_BPY_PYTHON")
    python = Path(named) if named else ROOT / ".venv-cycles" / "bin" / "python"
    return python if python.exists() else None
