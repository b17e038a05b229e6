"""Whether Blender wrote a stage: it means some of what it writes in a way of its own, and reads it back so."""

from __future__ import annotations

from typing import Any

__all__ = ["is_blenders"]


def is_blenders(prim: Any) -> bool:
    """Of the stage that a prim is in."""
    return str(prim.GetStage().GetRootLayer().documentation or "").startswith("Blender v")
