"""Loop subdivision rules for smooth interior points and edges; borders and creases use the Catmull-Clark rules.

Source: Loop 1987, "Smooth Subdivision Surfaces Based on Triangles".
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces

__all__ = ["interpolate", "limit", "on_edges", "smoothed", "split_triangles"]

F64 = npt.NDArray[np.float64]


def on_edges(points: F64, ends: Codes, edge_of_corner: Codes, across: Codes) -> F64:
    """Returns (E, w) the new points on the edges.

    ends: (E, 2) the end points of each edge; edge_of_corner: (C,) the edge from each corner to the next; across: (C,) the
    point opposite that edge.
    """
    faces = np.maximum(np.bincount(edge_of_corner, minlength=len(ends)), 1)[:, None]
    facing = _sums(points[across], edge_of_corner, len(ends)) / faces
    return np.asarray(0.375 * points[ends].sum(axis=1) + 0.25 * facing)


def smoothed(points: F64, ends: Codes) -> F64:
    """Returns (P, w) the positions of the existing points after one level of subdivision.

    ends: (E, 2) the end points of each edge.
    """
    valence, around = _neighbour_sums(points, ends)
    beta = _beta(valence)
    return np.asarray((1 - valence * beta) * points + beta * around)


def limit(points: F64, ends: Codes) -> F64:
    """Returns (P, w) the positions that the points approach after infinitely many levels.

    ends: (E, 2) end points of each edge.
    """
    valence, around = _neighbour_sums(points, ends)
    share = 1 / (valence + 0.375 / _beta(valence))
    return np.asarray((1 - valence * share) * points + share * around)


def split_triangles(corners: Codes, new_points: Codes) -> tuple[Faces, Codes]:
    """Splits each triangle into four; returns the new triangles, and the index of the old triangle for each.

    new_points: (C,) the new point between each corner and the next.
    """
    middle = new_points.reshape(-1, 3)
    outer = np.stack([corners, new_points, np.roll(middle, 1, axis=1).reshape(-1)], axis=1)
    old = np.arange(len(middle))
    return Faces(np.full(4 * len(middle), 3), np.concatenate([outer, middle]).reshape(-1)), np.append(np.repeat(old, 3), old)


def interpolate(values: AtCorners, faces: Faces, ahead: Codes, back: Codes) -> AtCorners:
    """Returns per-corner values for the triangles from `split_triangles`, interpolated linearly within each old triangle.

    ahead, back: (C,) the next and the previous corner of each corner.
    """
    own = values.corner_values().astype(np.float64)
    onward = (own + own[ahead]) / 2
    outer = np.stack([own, onward, onward[back]], axis=1).reshape(-1, own.shape[1])
    found = np.concatenate([outer, onward]).astype(np.float32)
    return AtCorners(found, np.arange(len(found)))


def _neighbour_sums(points: F64, ends: Codes) -> tuple[F64, F64]:
    """Returns (P, 1) the number of neighbours of each point, and (P, w) the sum of their values."""
    one, other = ends.reshape(-1), ends[:, ::-1].reshape(-1)
    valence = np.bincount(one, minlength=len(points)).astype(np.float64)[:, None]
    return valence, _sums(points[other], one, len(points))


def _beta(valence: F64) -> F64:
    n = np.maximum(valence, 1)
    return np.asarray((0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / n)) ** 2) / n)


def _sums(values: F64, group: Codes, count: int) -> F64:
    columns: list[npt.NDArray[Any]] = [np.bincount(group, values[:, k], count) for k in range(values.shape[1])]
    return np.stack(columns, axis=1)
