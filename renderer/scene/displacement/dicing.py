"""Splits the triangles of a mesh until all of their edges are short enough.

In each level every edge that is too long gets a point in its middle, and a triangle becomes two, three or four by the number of
its split edges. Whether an edge is split depends on its two end points alone, so the two sides of an edge agree and no cracks
open, also between vertices that differ in UVs or normals only. Points in the middle are exact in float64 to 29 levels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Diced", "Measure", "dice", "interpolate"]

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

MAX_LEVELS = 16
_CHUNK = 1 << 17  # triangles whose edges are measured at once

# Returns (K, 4, V) for points (V, 3): in each of K places their coordinates, and a factor for lengths there. The measure of an
# edge, relative to the longest wanted, is its length times the mean of its ends' factors, the largest over the places.
Measure = Callable[[F64], F64]


class Diced(NamedTuple):
    """A diced mesh.

    triangles: (T, 3) of all vertices: first those of the original mesh, then those of each level. levels: for each level the end
    points (E,) and (E,) of the split edges. expected: about as many triangles as complete dicing makes; `triangles` is complete
    if that is their number.
    """

    triangles: I32
    levels: list[tuple[I32, I32]]
    expected: int


def dice(points: F64, triangles: I32, measure: Measure, longest: float, most: int) -> Diced:
    """Splits a mesh's triangles until the measure of each edge is at most `longest`.

    Stops early, with an estimate of the number of triangles, when there would be more than `most`.
    """
    active, finished = triangles.astype(np.int64), [np.zeros((0, 3), np.int64)]
    count, levels, measured = 0, [], measure(points)
    for _ in range(MAX_LEVELS):
        ratio = _ratios(measured, active) / longest
        split = (ratio > 1.0) & (ratio < np.inf)  # no number of levels shortens an infinite edge
        whole = ~split.any(axis=1)
        finished.append(active[whole])
        count += int(whole.sum())
        active, split, ratio = active[~whole], split[~whole], ratio[~whole]
        if not len(active):
            break
        children = len(active) + int(split.sum())
        if count + children > most:
            return Diced(triangles, [], count + _expected(ratio))
        ends = np.stack([active, np.roll(active, -1, axis=1)], axis=-1)[split]
        codes, middle = np.unique(ends.min(axis=1) * len(points) + ends.max(axis=1), return_inverse=True)
        a, b = codes // len(points), codes % len(points)
        at = np.full(active.shape, -1, np.int64)
        at[split] = len(points) + middle
        middles = (points[a] + points[b]) / 2
        points, measured = np.concatenate([points, middles]), np.concatenate([measured, measure(middles)], axis=2)
        levels.append((a.astype(np.int32), b.astype(np.int32)))
        active = _children(points, active, at, split)
    finished.append(active)
    made = np.concatenate(finished).astype(np.int32)
    return Diced(made, levels, len(made))


def interpolate(values: npt.NDArray[Any], levels: list[tuple[I32, I32]]) -> npt.NDArray[Any]:
    """Returns the values (V, w) of a mesh's vertices at all vertices of the diced mesh."""
    for a, b in levels:
        values = np.concatenate([values, (values[a] + values[b]) / 2])
    return values


def _ratios(measured: F64, triangles: npt.NDArray[np.int64]) -> F64:
    """Returns (T, 3) the measures of each triangle's edges: from corner 0 to 1, from 1 to 2, and from 2 to 0."""
    found = np.zeros(triangles.shape)
    for at in range(0, len(triangles), _CHUNK):
        corners, part = triangles[at : at + _CHUNK], found[at : at + _CHUNK]
        for place in measured:
            x, y, z = (_differences(row[corners]) for row in place[:3])
            factor = place[3][corners]
            factor += np.roll(factor, -1, axis=1)
            np.maximum(part, np.sqrt(x * x + y * y + z * z) * factor * 0.5, out=part)
    return found


def _differences(values: F64) -> F64:
    return np.asarray(values - np.roll(values, -1, axis=1))


def _expected(ratio: F64) -> int:
    """Returns about how many triangles those with these edges (T, 3) become: four at each level that the longest edge takes."""
    mantissa, exponent = np.frexp(np.clip(ratio.max(axis=1), 1.0, 2.0**MAX_LEVELS))
    levels = exponent - (mantissa == 0.5)  # the logarithm rounded up, exactly
    return int(np.ldexp(1.0, 2 * levels).sum())


def _children(points: F64, active: npt.NDArray[np.int64], at: npt.NDArray[np.int64], split: npt.NDArray[np.bool_]) -> Any:
    """Returns the parts of triangles with split edges.

    at: (T, 3) the middle of each edge, where `split`.
    """
    count = split.sum(axis=1)
    found = []
    (a, b, c), (ab, bc, ca) = active[count == 3].T, at[count == 3].T
    found += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    (a, b, c), (ab, _, _) = _turned(active, at, count == 1, split)
    found += [(a, ab, c), (ab, b, c)]
    (a, b, c), (ab, bc, _) = _turned(active, at, count == 2, ~split, by=1)
    found.append((ab, b, bc))
    short = _squared(points[a], points[bc]) <= _squared(points[c], points[ab])
    found += [tuple(each[short] for each in three) for three in ((a, ab, bc), (a, bc, c))]
    found += [tuple(each[~short] for each in three) for three in ((a, ab, c), (ab, bc, c))]
    return np.concatenate([np.stack(three, axis=1) for three in found])


def _turned(active: Any, at: Any, chosen: Any, odd: Any, by: int = 0) -> tuple[Any, Any]:
    """Returns the corners (3, n) and the edges' middles (3, n) of the chosen triangles, turned.

    The edge for which `odd` is True becomes edge 0, then all are turned by `by` corners more.
    """
    first = (np.argmax(odd[chosen], axis=1) + by) % 3
    order = (first[:, None] + np.arange(3)) % 3
    return tuple(np.take_along_axis(each[chosen], order, axis=1).T for each in (active, at))  # type: ignore[return-value]


def _squared(a: F64, b: F64) -> F64:
    x, y, z = (a[:, k] - b[:, k] for k in range(3))
    return np.asarray(x * x + y * y + z * z)
