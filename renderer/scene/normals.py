"""Normals: of faces, carried through transforms, and made where a file has none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32, Mesh
from renderer.scene.unique import unique_rows

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
    faces = face_normals(mesh.positions, triangles)
    length = np.linalg.norm(faces, axis=1, keepdims=True)
    unit = np.divide(faces, length, out=np.zeros_like(faces), where=length > 0)
    # Vertices that differ in UV or colour alone are one point of the surface.
    first, number = unique_rows(mesh.positions)
    point = number[triangles.reshape(-1)]

    order = np.argsort(point, kind="stable")
    face = order // 3
    starts = np.flatnonzero(np.r_[True, np.diff(point[order]) > 0])
    valence = np.diff(np.r_[starts, len(order)])
    start, degree = np.repeat(starts, valence), np.repeat(valence, valence)
    rank = np.arange(len(order)) - start
    limit = np.cos(np.radians(crease_degrees))
    share = unit[face] * corner_angles(mesh.positions, triangles).reshape(-1, 1)[order]
    total = share.copy()
    # Each corner meets every other at its point: in step k all corners look at the one k places further on.
    for k in range(1, min(int(valence.max()), MAX_VALENCE)):
        corner = np.flatnonzero(degree > k)
        other = start[corner] + (rank[corner] + k) % degree[corner]
        near = np.einsum("ij,ij->i", unit[face[corner]], unit[face[other]]) > limit
        total[corner[near]] += share[other[near]]
    corners = np.empty((len(order), 3), np.float32)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    corners[order] = np.divide(total, size, out=total, where=size > 0)

    # Corners that agree in vertex and normal stay one vertex.
    attributes = (mesh.uvs, mesh.uvs1, mesh.colors)
    vertex = first[point] if all(a is None for a in attributes) else triangles.reshape(-1)
    key = np.column_stack([vertex, np.rint(corners * 1e4).astype(np.int32)])
    first, inverse = unique_rows(key)
    kept = vertex[first]
    joined = inverse.reshape(-1, 3).astype(np.int32)
    uvs, uvs1, colors = (None if a is None else a[kept] for a in attributes)
    return Mesh(mesh.name, mesh.positions[kept], joined, corners[first], uvs, mesh.material, uvs1, colors)


def corner_angles(positions: F32, triangles: I32) -> F64:
    """(T, 3) radians; 0 in triangles without an area."""
    corners = positions[triangles].astype(np.float64)
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    return np.arctan2(across, np.einsum("tkc,tkc->tk", to_next, to_last)) * (across > 0)
