"""Traces one path of one pixel again and prints its vertices, for debugging or as JSON."""

from __future__ import annotations

import json
import math
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from rayfarm.console import out

if TYPE_CHECKING:
    from renderer.scene.compiled import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["show_path"]

# The fields of a vertex do not fit one line, so they are grouped and listed below each other.
GROUPS = {
    "MET": ("kind", "object", "material"),
    "WHERE": ("point", "normal", "direction"),
    "LIGHT": ("throughput", "emitted", "direct", "beside"),
    "RAY": ("distance", "pdf"),
}


def show_path(
    compiled: CompiledScene, settings: RenderSettings, summary: dict[str, Any], x: int, y: int, sample: int, as_json: bool
) -> None:
    """Prints the vertices of a sample's path, and the value that was added to the film."""
    from renderer.render import replay

    path = replay(compiled, settings, x, y, sample)
    vertices = [_replace_numbers_by_names(vertex._asdict(), summary) for vertex in path.vertices]
    if as_json:
        found = {"pixel": [x, y], "sample": sample, "value": path.value, "vertices": vertices}
        print(json.dumps(_without_nonfinite(found), indent=1))
        return
    for line in _table(vertices):
        out.print(line, markup=False, soft_wrap=True)
    value = "not finite, and so left out of the film" if path.value is None else _text(path.value)
    out.print(f"Sample {sample} of pixel {x},{y}: {value}", markup=False)


def _replace_numbers_by_names(vertex: dict[str, Any], summary: dict[str, Any]) -> dict[str, Any]:
    """Replaces, in place, the numbers of a vertex's object and material by their names, and returns the vertex.

    A number without a name becomes None.
    """
    for field, names in (("object", summary["objects"]), ("material", summary["materials"])):
        number = vertex.get(field)
        if isinstance(number, int):
            vertex[field] = names[number] if 0 <= number < len(names) else None
    return vertex


def _table(vertices: list[dict[str, Any]]) -> list[str]:
    """Returns the vertices as lines of a table with one column per group of values.

    Lines may be wider than the terminal; numbers are not truncated.
    """
    rows = [["#", *GROUPS]]
    for number, vertex in enumerate(vertices):
        cells = [_cell(vertex, names) for names in GROUPS.values()]
        rows += [[str(number) if i == 0 else "", *line] for i, line in enumerate(zip_longest(*cells, fillvalue=""))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _cell(vertex: dict[str, Any], names: tuple[str, ...]) -> list[str]:
    if "kind" in names:
        return [_text(vertex[name]) for name in names]
    width = max(map(len, names))
    return [f"{name:<{width}} {_text(vertex[name])}" for name in names]


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return " ".join(_text(part) for part in value)
    if isinstance(value, float):
        return f"{value:.3g}"
    return "" if value is None else str(value)


def _without_nonfinite(value: Any) -> Any:
    """Returns the value with every NaN and infinity in it replaced by text, since JSON cannot represent them."""
    if isinstance(value, dict):
        return {key: _without_nonfinite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nonfinite(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
