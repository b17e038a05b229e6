"""Loop subdivision surfaces as in pbrt: a given number of levels, after which all points are moved to the limit surface.

Source: Loop 1987; Warren's weights and the limit positions: Pharr and Humphreys, Physically Based Rendering, 2nd edition, 3.8.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["subdivided"]

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class _Mesh(NamedTuple):
    """The connectivity of a triangle mesh: its edges, and sums over each point's neighbours."""

    edges: I64  # (E, 2)
    of: I64  # (T, 3) the edge from each corner to the next
    opposite: F64  # (E, 3) sum of the opposite points
    border: npt.NDArray[np.bool_]  # (E,)
    around: F64  # (V, 3) sum of the neighbours; for border points, of the two along the border
    valence: I64  # (V,)
    on_border: npt.NDArray[np.bool_]  # (V,)


def subdivided(points: F64, triangles: I64, levels: int) -> tuple[F64, I64]:
    """Returns (V, 3) points on the limit surface and (T, 3) triangles, after `levels` subdivisions."""
    for _ in range(levels):
        points, triangles = _subdivide_once(points, triangles)
    mesh = _surroundings(points, triangles)
    share = np.where(mesh.on_border, 0.2, 1 / (mesh.valence + 3 / (8 * _beta(mesh.valence))))
    return _average_with_neighbours(points, mesh, share), triangles


def _subdivide_once(points: F64, triangles: I64) -> tuple[F64, I64]:
    mesh = _surroundings(points, triangles)
    ends = points[mesh.edges].sum(axis=1)
    on_edges = np.where(mesh.border[:, None], ends / 2, 0.375 * ends + 0.125 * mesh.opposite)
    moved = _average_with_neighbours(points, mesh, np.where(mesh.on_border, 0.125, _beta(mesh.valence)))
    a, b, c = triangles.T
    ab, bc, ca = (len(points) + mesh.of).T
    finer = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    return np.concatenate([moved, on_edges]), np.ascontiguousarray(finer.transpose(2, 0, 1).reshape(-1, 3))


def _average_with_neighbours(points: F64, mesh: _Mesh, share: F64) -> F64:
    """Returns weighted means of each point and its neighbours; isolated points are unchanged.

    share: weight of each neighbour. The point itself has the remaining weight.
    """
    count = np.where(mesh.on_border, 2, mesh.valence)
    alone = (mesh.valence == 0)[:, None]
    return np.where(alone, points, (1 - count * share)[:, None] * points + share[:, None] * mesh.around)


def _beta(valence: I64) -> F64:
    return np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))


def _surroundings(points: F64, triangles: I64) -> _Mesh:
    count = len(points)
    start, end, across = (
        triangles.reshape(-1),
        np.roll(triangles, -1, axis=1).reshape(-1),
        np.roll(triangles, -2, axis=1).reshape(-1),
    )
    codes = np.minimum(start, end) * count + np.maximum(start, end)
    unique, of, faces = np.unique(codes, return_inverse=True, return_counts=True)
    edges = np.stack([unique // count, unique % count], axis=1)
    opposite = _sums(of, points[across], len(edges)) * (2 / np.maximum(faces, 2))[:, None]  # the mean for non-manifold edges
    border = faces == 1
    on_border = np.zeros(count, bool)
    on_border[edges[border]] = True
    both = np.concatenate([edges, edges[:, ::-1]])
    twice = np.concatenate([border, border])
    counts = twice | ~on_border[both[:, 0]]
    around = _sums(both[counts, 0], points[both[counts, 1]], count)
    valence = np.bincount(both[:, 0], minlength=count)
    return _Mesh(edges, of.reshape(triangles.shape), opposite, border, around, valence, on_border)


def _sums(index: I64, values: F64, count: int) -> F64:
    columns: list[npt.NDArray[Any]] = [np.bincount(index, values[:, k], count) for k in range(values.shape[1])]
    return np.stack(columns, axis=1)
