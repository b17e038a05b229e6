"""Normals: of faces, carried through transforms, and made where a file has none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.smooth import blend_normals, join_corners, measure_corners, sort_corners
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.readable import read_only
from renderer.scene.unique import unique_threes

__all__ = ["CREASE_DEGREES", "cofactors", "corner_angles", "face_normals", "smoothed"]

CREASE_DEGREES = 40.0  # edges that bend more stay sharp: a sphere of 16 segments is round, a box is a box
MAX_VALENCE = 64

F64 = npt.NDArray[np.float64]


def face_normals(positions: npt.NDArray[np.floating], triangles: I32) -> F64:
    """(T, 3) normals as long as twice each triangle's area, to the counter-clockwise side."""
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def cofactors(transform: F64) -> F64:
    """The 3x3 matrix that carries normals through a 4x4 transform, up to their length.

    det(M) M^-T, which exists for singular M too. A mirroring transform turns a triangle's winding around; who uses this
    swaps the winding back, so that outside stays outside, and the sign of det is taken off here.
    """
    x, y, z = transform[:3, 0], transform[:3, 1], transform[:3, 2]
    matrix = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    return -matrix if np.dot(x, matrix[:, 0]) < 0 else matrix


def smoothed(mesh: Mesh, crease_degrees: float = CREASE_DEGREES) -> Mesh:
    """A mesh without normals, with them: smooth over edges that bend by less than the crease angle, sharp elsewhere.

    Every corner's normal is the mean of the faces at its position that lie within the crease angle of its own, weighted by
    their angles there, so that it does not matter how a polygon was cut. Source: Thuermer and Wuethrich 1998.
    """
    triangles = mesh.triangles
    if mesh.normals is not None or len(triangles) == 0:
        return mesh
    count = triangles.size
    positions, triangles = read_only(np.asarray(mesh.positions, np.float32)), read_only(np.asarray(triangles, np.int32))
    if triangles.min() < 0 or triangles.max() >= len(positions):
        raise IndexError(f"a triangle of {mesh.name} names a vertex that is not there")
    # Vertices that differ in UV or colour alone are one point of the surface.
    first, number = unique_threes(positions + np.float32(0))  # there are two zeros
    start, order = np.zeros(len(first) + 1, np.int64), np.empty(count, np.int64)
    sort_corners(triangles, number, start, order)
    unit, across, along = np.empty((len(triangles), 3)), np.empty(count), np.empty(count)
    measure_corners(positions, triangles, unit, across, along)
    angle = np.arctan2(across, along) * (across > 0)
    normals = np.empty((count, 3), np.float32)
    blend_normals(unit, angle, start, order, np.cos(np.radians(crease_degrees)), MAX_VALENCE, normals)

    # Corners that agree in vertex and normal stay one vertex.
    attributes = (mesh.uvs, mesh.uvs1, mesh.colors)
    corners = triangles.reshape(-1)
    vertex = first[number[corners]] if all(a is None for a in attributes) else np.array(corners)
    kind, kept = np.full(count, -1, np.int32), np.empty(count, np.int32)
    kept = kept[: join_corners(vertex, normals, start, order, kind, kept)]
    uvs, uvs1, colors = (None if a is None else a[vertex[kept]] for a in attributes)
    shown = mesh.positions[vertex[kept]]
    return Mesh(mesh.name, shown, kind.reshape(-1, 3), normals[kept], uvs, mesh.material, uvs1, colors)


def corner_angles(positions: F32, triangles: I32) -> F64:
    """(T, 3) radians; 0 in triangles without an area."""
    corners = positions[triangles].astype(np.float64)
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    return np.arctan2(across, np.einsum("tkc,tkc->tk", to_next, to_last)) * (across > 0)
