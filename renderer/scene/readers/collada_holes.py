"""Converts Collada's polygons with holes (<ph>) to simple polygons.

A bridge edge, traversed in both directions, joins each hole to the outline.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

__all__ = ["bridge_holes", "without_holes"]

Indices = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]
_MOST_PAIRS = 200_000  # candidate bridges; with more, the shortest is taken untested


def bridge_holes(data: bytes) -> tuple[bytes, int]:
    """Returns a Collada document in which each polygon with holes (<ph>) is replaced by a simple one (<p>).

    Also returns the number of holes that could not be joined to their outline and are therefore filled.
    """
    if b"ph>" not in data:
        return data, 0
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError:
        return data, 0
    filled = 0
    for mesh in root.iter():
        if _name(mesh) == "mesh":
            with suppress(ValueError):  # invalid integers are reported by assimp
                filled += sum(_bridge(polygons, mesh) for polygons in mesh if _name(polygons) == "polygons")
    namespace = root.tag[1:].partition("}")[0] if root.tag.startswith("{") else ""
    if namespace:
        ElementTree.register_namespace("", namespace)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True), filled


def _name(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _bridge(polygons: ElementTree.Element, mesh: ElementTree.Element) -> int:
    inputs = [each for each in polygons if _name(each) == "input"]
    width = max((int(each.get("offset", 0)) for each in inputs), default=0) + 1
    corner = next((each for each in inputs if each.get("semantic") == "VERTEX"), None)
    points = None if corner is None else _points(corner.get("source", "")[1:], mesh)
    filled = 0
    for element in list(polygons):
        if _name(element) != "ph":
            continue
        loops = [np.array((each.text or "").split(), np.int64) for each in element if _name(each) in ("p", "h")]
        if not loops:
            continue
        rows = [loop[: len(loop) // width * width].reshape(-1, width) for loop in loops]
        at = 0 if corner is None else int(corner.get("offset", 0))
        merged = rows[0]
        holes = [row for row in rows[1:] if len(row) >= 3]
        inside = points is not None and all((row[:, at] < len(points)).all() and (row >= 0).all() for row in rows)
        if points is not None and inside and len(merged) >= 3:
            whole = np.concatenate([merged, *holes])
            starts = np.cumsum([0, len(merged), *map(len, holes)])
            loops_of = [np.arange(a, b) for a, b in pairwise(starts.tolist())]
            found = [whole[loop] for loop in without_holes(points[whole[:, at]], loops_of)]
        else:
            found = [merged]
            filled += len(holes)
        polygons.remove(element)
        for loop in found:
            replaced = ElementTree.SubElement(polygons, str(element.tag)[: -len("ph")] + "p")
            replaced.text = " ".join(map(str, loop.reshape(-1).tolist()))
    polygons.set("count", str(sum(_name(each) == "p" for each in polygons)))
    return filled


def _points(vertices: str, mesh: ElementTree.Element) -> F64 | None:
    """Returns the (V, 3) vertex positions of a mesh; None if they are missing. vertices: id of its <vertices> element."""
    by_id = {each.get("id"): each for each in mesh}
    said = by_id.get(vertices)
    source: Any = None
    for each in said if said is not None else ():
        if each.get("semantic") == "POSITION":
            source = by_id.get(each.get("source", "")[1:])
    numbers = None if source is None else source.find("{*}float_array")
    if numbers is None:
        return None
    accessor = source.find("{*}technique_common/{*}accessor")
    stride = max(int(accessor.get("stride", 3)) if accessor is not None else 3, 3)
    values = np.array((numbers.text or "").split(), np.float64)
    return values[: len(values) // stride * stride].reshape(-1, stride)[:, :3]


def without_holes(points: F64, loops: list[Indices]) -> list[Indices]:
    """Returns simple loops that cover the outline `loops[0]` except for its holes, which are the other loops.

    points: (n, 3); loops: indices of points.
    """
    axes, origin, sign = _plane(points[loops[0]])
    flat = (points[:, axes] - origin) * sign  # the outline is counter-clockwise there
    outline = loops[0] if _area(flat[loops[0]]) >= 0 else loops[0][::-1]
    turned = [outline, *(hole if _area(flat[hole]) < 0 else hole[::-1] for hole in loops[1:])]
    turned = _without_shared_edges(points, turned)
    outlines = [loop for loop in turned if _area(flat[loop]) > 0]
    holes = [loop for loop in turned if _area(flat[loop]) < 0]
    found = []
    for loop in outlines:
        own = holes if len(outlines) == 1 else [hole for hole in holes if _contains(flat[loop], flat[hole].mean(axis=0))]
        found.append(_joined(flat, loop, own))
    return found


def _without_shared_edges(points: F64, loops: list[Indices]) -> list[Indices]:
    """Returns the loops without any edge that two of them traverse in opposite directions; the two loops are thereby joined.

    A hole that shares an edge with the outline thus becomes a notch.
    """
    _, place = np.unique(points, axis=0, return_inverse=True)
    place = place.reshape(-1)
    left: dict[tuple[int, int], int] = {}
    shared = False
    for loop in loops:
        for a, b in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True):
            start, end = int(place[a]), int(place[b])
            if (end, start) in left:
                del left[end, start]
                shared = True
            elif start != end:
                left[start, end] = a
    if not shared:
        return loops
    onward: dict[int, list[int]] = {}
    for start, end in left:
        onward.setdefault(start, []).append(end)
    found = []
    while onward:
        first = here = next(iter(onward))
        rows = []
        while here in onward:
            end = onward[here].pop()
            if not onward[here]:
                del onward[here]
            rows.append(left[here, end])
            here = end
            if here == first:
                break
        found.append(np.array(rows, np.int64))
    return [loop for loop in found if len(loop) >= 3]


def _contains(loop: F64, point: F64) -> bool:
    ahead = np.roll(loop, -1, axis=0)
    spans = (loop[:, 1] > point[1]) != (ahead[:, 1] > point[1])
    rise = np.where(spans, ahead[:, 1] - loop[:, 1], 1.0)
    at = loop[:, 0] + (point[1] - loop[:, 1]) * (ahead[:, 0] - loop[:, 0]) / rise
    return bool((spans & (at > point[0])).sum() % 2)


def _joined(flat: F64, merged: Indices, holes: list[Indices]) -> Indices:
    holes = sorted(holes, key=lambda hole: -float(flat[hole, 0].max()))
    for k, hole in enumerate(holes):
        i, j = _bridge_of(flat, merged, hole, holes[k + 1 :])
        around = np.concatenate([hole[j:], hole[: j + 1]])
        merged = np.concatenate([merged[: i + 1], around, merged[i:]])
    return merged


def _plane(outline: F64) -> tuple[list[int], F64, F64]:
    """Returns the coordinate plane best aligned with an outline: two axes, the outline's first corner there, and a sign per axis.

    With the signs applied to the coordinates, the outline is counter-clockwise in this plane.
    """
    ahead = np.roll(outline, -1, axis=0)
    normal = np.cross(outline - outline[0], ahead - outline[0]).sum(axis=0)
    axes = [k for k in range(3) if k != int(np.argmax(np.abs(normal)))]
    origin = outline[0, axes]
    sign = np.array([1.0 if _area(outline[:, axes] - origin) >= 0 else -1.0, 1.0])
    return axes, origin, sign


def _area(loop: F64) -> float:
    ahead = np.roll(loop, -1, axis=0)
    return float((loop[:, 0] * ahead[:, 1] - loop[:, 1] * ahead[:, 0]).sum()) / 2


def _bridge_of(flat: F64, merged: Indices, hole: Indices, others: list[Indices]) -> tuple[int, int]:
    """Returns the shortest segment from a loop to a hole that crosses no edge, as (position in the loop, position in the hole).

    flat: (n, 2) points; merged: the loop; others: further holes, whose edges must not be crossed either. If every segment crosses
    an edge, or if there are too many to test, the shortest of all is returned.
    """
    apart = np.linalg.norm(flat[merged][:, None] - flat[hole][None], axis=2)
    nearest = np.unravel_index(int(np.argmin(apart)), apart.shape)
    if apart.size > _MOST_PAIRS:
        return int(nearest[0]), int(nearest[1])
    loops = [merged, hole, *others]
    begin, end = (np.concatenate([flat[np.roll(loop, -shift)] for loop in loops]) for shift in (0, 1))
    for pair in np.argsort(apart, axis=None, kind="stable").tolist():
        i, j = divmod(pair, len(hole))
        a, b = flat[merged[i]], flat[hole[j]]
        if not _crosses(a, b, begin, end) and _is_within(flat, merged, i, b):
            return i, j
    return int(nearest[0]), int(nearest[1])


def _crosses(a: F64, b: F64, begin: F64, end: F64) -> bool:
    def signed_area(p: F64, q: F64, r: F64) -> F64:
        found: F64 = (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        return found

    return bool(
        (
            (signed_area(a, b, begin) * signed_area(a, b, end) < 0)
            & (signed_area(begin, end, a) * signed_area(begin, end, b) < 0)
        ).any()
    )


def _is_within(flat: F64, loop: Indices, i: int, end: F64) -> bool:
    """Returns True if the segment from corner `i` of a loop to the point `end` begins inside the loop.

    This is tested because several corners of a loop may coincide, and then only some of them see the loop's inside.
    """
    here, last, following = flat[loop[i]], flat[loop[i - 1]], flat[loop[(i + 1) % len(loop)]]
    if (end == here).all():
        return True

    def cross_product(p: F64, q: F64) -> float:
        return float(p[0] * q[1] - p[1] * q[0])

    ahead, back, way = following - here, last - here, end - here
    if cross_product(ahead, back) > 0:
        return cross_product(ahead, way) >= 0 and cross_product(way, back) >= 0
    return not (cross_product(back, way) > 0 and cross_product(way, ahead) > 0)
