"""How the scripts beside this write a scene file."""

from __future__ import annotations

import json
from typing import Any

__all__ = ["text_of"]


def text_of(scene: dict[str, Any], comment: str, script: str) -> str:
    """The scene as YAML, a line for every entry: JSON's flow style is YAML too, and short."""
    lines = [f"# {comment}", f"# Written by scenes/{script}, which says where its numbers come from: edit that, not this."]
    for key, value in scene.items():
        if isinstance(value, list):
            lines += [f"{key}:", *(f"  - {json.dumps(item)}" for item in value)]
        elif isinstance(value, dict) and all(isinstance(v, dict) for v in value.values()):
            lines += [f"{key}:", *(f"  {name}: {json.dumps(item)}" for name, item in value.items())]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"
