"""Shapes of scene files, and the YAML writer, shared by the example scripts."""

from __future__ import annotations

import json
from typing import Any

__all__ = ["Scene", "Shape", "faces", "sphere", "text_of"]

Scene = dict[str, Any]
Shape = dict[str, Any]


def sphere(name: str, material: str, center: tuple[float, ...], radius: float, **more: Any) -> Shape:
    """Returns a sphere."""
    return {
        "name": name,
        "type": "sphere",
        "material": material,
        "center": [round(c, 4) for c in center],
        "radius": radius,
        **more,
    }


def faces(name: str, material: str, positions: list[list[float]], faces: list[list[int]], **more: Any) -> Shape:
    """Returns polygons over points numbered from 0."""
    return {"name": name, "type": "faces", "material": material, "positions": positions, "faces": faces, **more}


def text_of(scene: Scene, comment: str, script: str, frames: str | None = None) -> str:
    """Returns the scene as YAML with a line per entry, in JSON's flow style. frames: number of frames of a shot."""
    lines = [f"# {comment}", f"# Written by scenes/{script}, which says where its numbers come from: edit that, not this."]
    if frames:
        lines.append(f"# Frames {frames}")
    for key, value in scene.items():
        if isinstance(value, list):
            lines += [f"{key}:", *(f"  - {json.dumps(item)}" for item in value)]
        elif isinstance(value, dict) and all(isinstance(v, dict) for v in value.values()):
            lines += [f"{key}:", *(f"  {name}: {json.dumps(item)}" for name, item in value.items())]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"
