"""One path of one pixel, followed again: its vertices for a person who looks for what went wrong, or for a program."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from rich.table import Table

from rayfarm.console import out

if TYPE_CHECKING:
    from renderer.scene.compiled import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["show_path"]


def show_path(
    compiled: CompiledScene, settings: RenderSettings, summary: dict[str, Any], x: int, y: int, sample: int, as_json: bool
) -> None:
    """Print the vertices of a sample's path and its value: what the film gets of it."""
    from renderer.render import replay

    path = replay(compiled, settings, x, y, sample)
    vertices = [_named(vertex._asdict(), summary) for vertex in path.vertices]
    value = None if path.value is None else list(path.value)
    if as_json:
        found = {"pixel": [x, y], "sample": sample, "value": value, "vertices": vertices}
        print(json.dumps(_plain(found), indent=1))
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("#", justify="right")
    for title in vertices[0] if vertices else ():
        table.add_column(title, overflow="fold")
    for number, vertex in enumerate(vertices):
        table.add_row(str(number), *(_text(field) for field in vertex.values()))
    out.print(table)
    if value is None:
        out.print(f"Sample {sample} of pixel {x},{y} is not finite, and so left out of the film.", markup=False)
    else:
        out.print(f"Sample {sample} of pixel {x},{y}: {_text(value)}", markup=False)


def _named(vertex: dict[str, Any], summary: dict[str, Any]) -> dict[str, Any]:
    """Names instead of the numbers of objects and materials, where the scene has them."""
    for field, names in (("object", summary["objects"]), ("material", summary["materials"])):
        number = vertex.get(field)
        if isinstance(number, int):
            vertex[field] = names[number] if 0 <= number < len(names) else None
    return vertex


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return " ".join(_text(part) for part in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become text."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
