"""Concatenates sections of geometry into the arrays that the kernel reads.

In each array each section starts at a page boundary, so that the sections' files can be mapped consecutively
(renderer/scene/compiled_parts.py). The padding before it contains no geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.subtrees import padded
from renderer.scene.description import I32
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.geometry import NO_PLACEMENT, Geometry, Section, by_triangle

__all__ = ["Joined", "join"]

Array = npt.NDArray[Any]

_WIDTHS = {"position": 3, "normal": 3, "uv": 2, "uv1": 2, "color": 4, "tangent": 4}
_ROW_BYTES = 4  # of the narrowest vertex or triangle array: rows that end at a page boundary there do so in all arrays


class Joined(NamedTuple):
    """The geometry of all sections in one set of arrays.

    first_vertex, first_triangle: the index at which each section starts, followed by the total number.
    """

    geometry: Geometry
    triangle: I32  # (T, 4): each with its part
    first_vertex: tuple[int, ...]
    first_triangle: tuple[int, ...]


def join(sections: Sequence[Section], has_uvs: bool, shot_cache: ShotCache) -> Joined:
    """Concatenates the geometry of the sections.

    has_uvs: whether any material has a texture, or needs UVs otherwise; else UVs are omitted. shot_cache: keeps the concatenated
    arrays from frame to frame; if all sections but the last are unchanged, only the last one's rows are written again.
    """
    parts = [section.geometry for section in sections]
    vertex, triangle = (_starts([len(getattr(p, name)) for p in parts]) for name in ("position", "triangle"))
    parting, first_part = _part_columns(parts, triangle)
    heads = tuple(parts[:-1])
    arrays: dict[str, Any] = {}
    is_one = not any(len(p.position) for p in parts[1:])
    for name, width in _WIDTHS.items():
        wanted = any(len(getattr(p, name)) for p in parts) and (has_uvs or name not in ("uv", "uv1"))
        if is_one and wanted:
            arrays[name] = getattr(parts[0], name)
            continue
        count = vertex[-1] if wanted else 0
        array, is_there = shot_cache.array_for(name, count, (width,), np.float32, heads if wanted else ())
        for at, part in list(zip(vertex, parts, strict=False))[len(heads) if is_there else 0 :] if wanted else ():
            array[at : at + len(part.position)] = _attribute_or_default(part, name)
        arrays[name] = array
    corners, is_there = shot_cache.array_for("triangle", triangle[-1], (4,), np.int32, heads)
    for i in range(len(heads) if is_there else 0, len(parts)):
        at, end = triangle[i], triangle[i] + len(parts[i].triangle)
        np.add(parts[i].triangle, np.int32(vertex[i]), out=corners[at:end, :3])
        numbers = np.arange(first_part[i], first_part[i] + len(parts[i].material), dtype=np.int32)
        corners[at:end, 3] = by_triangle(parts[i], numbers)
        corners[end : triangle[i + 1], :3] = 0
        corners[end : triangle[i + 1], 3] = first_part[i] + len(numbers)
    whole = Geometry(**arrays, triangle=corners[:, :3], **parting, keys=parts[-1].keys)
    return Joined(whole, corners, vertex, triangle)


def _starts(lengths: Sequence[int]) -> tuple[int, ...]:
    starts = [0]
    for i, length in enumerate(lengths):
        end = starts[-1] + length
        starts.append(padded(end, _ROW_BYTES) if any(lengths[i + 1 :]) else end)
    return tuple(starts)


def _part_columns(parts: Sequence[Geometry], starts: Sequence[int]) -> tuple[dict[str, Any], list[int]]:
    """Concatenates the part tables of several sections; a part is a run of triangles of one object and one material.

    starts: the number of the first triangle of each section, followed by the total. Returns (the columns of the joint table,
    the row at which each section's parts begin). The columns are `first` (the number of a part's first triangle), `material`
    and `object`. The padding triangles at the end of a section form a part without an object.
    """
    first, material, object, number = [], [], [], []
    count = 0
    for part, start, end in zip(parts, starts, starts[1:], strict=False):
        number.append(count)
        last = start + len(part.triangle)
        is_filled = int(last < end)
        first += [part.first[:-1] + np.int32(start), np.full(is_filled, last, np.int32)]
        material += [part.material, np.zeros(is_filled, np.int32)]
        object += [part.object, np.full(is_filled, NO_PLACEMENT, np.int32)]
        count += len(part.material) + is_filled
    first.append(np.array([starts[-1]], np.int32))
    columns = {name: np.concatenate(column) for name, column in (("first", first), ("material", material), ("object", object))}
    return columns, number


def _attribute_or_default(part: Geometry, name: str) -> Array | float:
    """Returns the vertex attribute `name` of a section's geometry, or a default if the geometry lacks it.

    The default is the first UVs for second UVs, 1 for colours, and 0 for other attributes.
    """
    found: Array = getattr(part, name)
    if len(found):
        return found
    return part.uv if name == "uv1" else 1.0 if name == "color" else 0.0
