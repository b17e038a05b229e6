"""Places many small meshes in one call: separate calls would take far longer than the work itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.faces import find_solid
from renderer.kernel.mesh.vertices import place_all_normals, place_all_points
from renderer.scene.description import F32, Mesh
from renderer.scene.kernel_arguments import read_only
from renderer.scene.normals import cofactors
from renderer.scene.placed_mesh import MAX_COORDINATE, Placed, finite

__all__ = ["MOST_VERTICES", "placed_together"]

MOST_VERTICES = 2000  # of a small mesh


def placed_together(
    meshes: Sequence[Mesh], transforms: Sequence[npt.NDArray[np.float64]]
) -> tuple[Placed, npt.NDArray[np.int64]] | None:
    """Transforms and concatenates meshes as `placed` does for each; also returns each mesh's number of triangles.

    All meshes must have normals, vertices and triangles, and no material that needs tangents. Returns None if one of them has to
    be placed by `placed`: its positions exceed float32, or a normal has length zero.
    """
    matrix = np.array([np.asarray(each, np.float64) for each in transforms])
    start = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    point = read_only(np.concatenate([mesh.positions for mesh in meshes]).astype(np.float32, copy=False))
    position = np.empty((len(point), 3), np.float32)
    if not place_all_points(point, matrix, start, position) <= MAX_COORDINATE:
        return None
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    given = read_only(np.concatenate(normals).astype(np.float32, copy=False))
    normal, length = np.empty((len(given), 3), np.float32), np.empty(len(given))
    place_all_normals(given, np.ascontiguousarray(cofactors(matrix)), start, normal, length)
    most = np.repeat(np.maximum.reduceat(length, start[:-1]), np.diff(start))
    if not (length > 1e-12 * np.maximum(most, 1e-300)).all() or not np.isfinite(length).all():
        return None
    count = np.array([len(mesh.triangles) for mesh in meshes])
    triangle = np.concatenate([mesh.triangles for mesh in meshes]).astype(np.int32, copy=False)
    triangle = triangle + np.repeat(start[:-1], count).astype(np.int32)[:, None]
    mirrors = np.repeat(np.linalg.det(matrix[:, :3, :3]) < 0, count)
    triangle[mirrors] = triangle[mirrors][:, [0, 2, 1]]
    position, triangle = read_only(position), read_only(triangle)
    solid = np.empty(len(triangle), bool)
    dropped = len(triangle) - find_solid(position, triangle, 0, len(triangle), solid)
    if dropped:
        triangle = np.ascontiguousarray(triangle[solid])
        count = np.add.reduceat(solid, np.cumsum(count) - count, dtype=np.int64)
    uv = _joined_attribute("uvs", meshes, start, np.zeros((len(position), 2), np.float32))
    none = np.zeros((0, 4), np.float32)
    has_second, has_colors = (any(getattr(m, name) is not None for m in meshes) for name in ("uvs1", "colors"))
    second = _joined_attribute("uvs1", meshes, start, uv.copy()) if has_second else none[:, :2]
    color = (
        np.clip(_joined_attribute("colors", meshes, start, np.ones((len(position), 4), np.float32)), 0, 1) if has_colors else none
    )
    return Placed(position, normal, uv, second, color, none, triangle, dropped), count


def _joined_attribute(name: str, meshes: Sequence[Mesh], start: npt.NDArray[np.int64], defaults: F32) -> F32:
    """Concatenates the attribute `name` of all meshes: (V, w).

    start: the index of each mesh's first vertex. defaults: (V, w), the values for vertices of meshes without the attribute; it is
    overwritten and returned.
    """
    for mesh, begin, end in zip(meshes, start.tolist(), start[1:].tolist(), strict=False):
        values = getattr(mesh, name)
        if values is not None:
            defaults[begin:end] = values
    return finite(defaults, *defaults.shape)
