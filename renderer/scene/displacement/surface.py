"""Moves the vertices of a diced mesh along their normals, and computes its new normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.displacement.dicing import Diced, interpolate
from renderer.scene.normals import face_normals

__all__ = ["displaced_surface", "with_normals"]

F64 = npt.NDArray[np.float64]

_PRECISION = 1e4  # normals are compared after rounding to 1 / _PRECISION, as renderer/kernel/mesh/smooth.py does
_OPPOSED = 0.1  # length of the mean of unit normals below which vertices of one position are of different surfaces


def with_normals(mesh: Mesh) -> Mesh:
    """Returns the mesh with normals: those of its faces, with a vertex for each corner, if it has none."""
    if mesh.normals is not None:
        return mesh
    corner = mesh.triangles.reshape(-1)

    def faceted(positions: npt.NDArray[Any]) -> F32:
        return np.repeat(face_normals(positions, mesh.triangles), 3, axis=0).astype(np.float32)

    uvs, uvs1, colors = (None if each is None else each[corner] for each in (mesh.uvs, mesh.uvs1, mesh.colors))
    return replace(
        mesh,
        positions=mesh.positions[corner],
        triangles=np.arange(len(corner), dtype=np.int32).reshape(-1, 3),
        normals=faceted(mesh.positions),
        uvs=uvs,
        uvs1=uvs1,
        colors=colors,
        keys=tuple((positions[corner], faceted(positions)) for positions, _ in mesh.keys),
    )


def displaced_surface(mesh: Mesh, diced: Diced, heights: Callable[[F32], F32], uv_set: int) -> Mesh:
    """Returns the displaced mesh, with smooth normals except where its own are sharp.

    Vertices of one position are moved by the mean of their displacements, so that creases and seams of UVs stay closed. mesh: has
    normals, and UVs of the set. heights: returns the height (N,) at UVs (N, 2).
    """
    uvs, uvs1, colors = (
        None if each is None else interpolate(each, diced.levels).astype(np.float32)
        for each in (mesh.uvs, mesh.uvs1, mesh.colors)
    )
    chosen = uvs1 if uv_set else uvs
    assert chosen is not None
    height = heights(chosen).astype(np.float64)
    (positions, normals), *keys = (
        _moved(position, normal, diced, height)
        for position, normal in ((mesh.positions, mesh.normals), *((p, mesh.normals if n is None else n) for p, n in mesh.keys))
    )
    return replace(
        mesh,
        positions=positions,
        triangles=diced.triangles,
        normals=normals,
        uvs=uvs,
        uvs1=uvs1,
        colors=colors,
        tangents=None,
        keys=tuple(keys),
    )


def _moved(positions: npt.NDArray[Any], normals: F32 | None, diced: Diced, height: F64) -> tuple[npt.NDArray[Any], F32]:
    """Returns the displaced positions and their normals, of all vertices of the diced mesh. positions, normals: of the mesh."""
    assert normals is not None
    triangles = diced.triangles
    points = interpolate(positions.astype(np.float64), diced.levels)
    direction = _unit(interpolate(_unit(normals.astype(np.float64)), diced.levels))
    relative = (points - points[0]).astype(np.float32) + np.float32(0)  # turns -0 into 0
    first, point = unique_threes(relative)
    count = np.bincount(point)
    offset = _sums(direction * height[:, None], point, len(first)) / count[:, None]
    mean = _sums(direction, point, len(first)) / count[:, None]
    is_one = _lengths(mean) >= _OPPOSED
    moved = np.where(is_one[point, None], points[first[point]] + offset[point], points + direction * height[:, None])
    del offset, mean, relative
    kind = _smooth_groups(direction, np.where(is_one[point], point, len(first) + np.arange(len(point))).astype(np.int32))
    return moved.astype(positions.dtype), _smooth_normals(moved, triangles, kind, direction)


def _smooth_groups(direction: F64, point: I32) -> I32:
    """Returns the number (V,) of the group of vertices that share a normal: those of one position whose normals were equal."""
    code = np.rint(direction * _PRECISION).astype(np.int32)
    base = np.int32(2 * _PRECISION + 1)
    return unique_threes(np.column_stack([point, code[:, 0] * base + code[:, 1], code[:, 2]]))[1]


def _smooth_normals(points: F64, triangles: I32, kind: I32, fallback: F64) -> F32:
    """Returns (V, 3) normals: the mean, weighted by area, of the faces at the vertices of a kind."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    del a, b, c
    face = np.stack([u[:, i] * v[:, j] - u[:, j] * v[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
    count = int(kind.max()) + 1
    total = sum(_sums(face, kind[triangles[:, k]], count) for k in range(3))
    length = _lengths(np.asarray(total))
    scaled = total / np.where(length > 0, length, 1.0)[:, None]
    return np.where((length > 0)[kind, None], scaled[kind], fallback).astype(np.float32)


def _unit(vectors: F64) -> F64:
    length = _lengths(vectors)
    return np.asarray(vectors / np.where(length > 0, length, 1.0)[:, None])


def _lengths(vectors: F64) -> F64:
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _sums(values: F64, group: npt.NDArray[Any], count: int) -> F64:
    columns: list[npt.NDArray[Any]] = [np.bincount(group, values[:, k], count) for k in range(3)]
    return np.stack(columns, axis=1)
