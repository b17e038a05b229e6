"""Detects stages written by Blender, whose exporter and importer deviate from the USD schemas in some points."""

from __future__ import annotations

from typing import Any

__all__ = ["is_written_by_blender"]


def is_written_by_blender(prim: Any) -> bool:
    """Returns True if Blender wrote the stage that contains a prim."""
    return str(prim.GetStage().GetRootLayer().documentation or "").startswith("Blender v")
