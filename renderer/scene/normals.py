"""Normals: of faces, under transforms, and computed for meshes without any."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.smooth import measure_corners, round_corners, sort_corners
from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.kernel_arguments import read_only
from renderer.scene.origin import split_offset

__all__ = ["CREASE_DEGREES", "cofactors", "corner_angles", "face_normals", "smoothed", "smoothed_together"]

CREASE_DEGREES = 40.0  # edges that bend more stay sharp: a sphere of 16 segments is round, a box is a box
MAX_VALENCE = 64

F64 = npt.NDArray[np.float64]


def face_normals(positions: npt.NDArray[np.floating], triangles: I32) -> F64:
    """Returns (T, 3) face normals: of length twice the triangle's area, pointing to its counter-clockwise side."""
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def cofactors(transform: F64) -> F64:
    """Returns the cofactor matrix (..., 3, 3) of a (..., 4, 4) transform, which transforms normals up to their length.

    It is |det(M)| M^-T, and exists for singular M too. A reflection reverses a triangle's winding; callers swap it back, so that
    the outside remains outside, and therefore the sign of det is omitted.
    """
    x, y, z = (transform[..., :3, k] for k in range(3))
    matrix = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-1)
    mirrors = (x * matrix[..., 0]).sum(axis=-1) < 0
    return np.where(mirrors[..., None, None], -matrix, matrix)


def smoothed(mesh: Mesh, crease_degrees: float = CREASE_DEGREES) -> Mesh:
    """Returns the mesh with computed normals: smooth across edges whose faces differ by less than the crease angle, else sharp.

    A corner's normal is the mean of the normals of all faces at that position within the crease angle of the corner's own face,
    weighted by the faces' angles there, so that it does not depend on a polygon's triangulation. Source: Thuermer and Wuethrich
    1998.
    """
    return smoothed_together([mesh], crease_degrees)[0]


def smoothed_together(
    meshes: Sequence[Mesh], crease_degrees: float = CREASE_DEGREES, surfaces: Sequence[int | I32] | None = None
) -> list[Mesh]:
    """Smooths several meshes as `smoothed` does, in one batch, since files have a hundred thousand small ones.

    surfaces: for each mesh, or for each of its triangles, the number of its surface. Triangles of one surface are smooth across
    meshes too, such as a sphere of two materials. By default each mesh is one surface.
    """
    found = list(meshes)
    bare = [i for i, mesh in enumerate(meshes) if mesh.normals is None and len(mesh.triangles)]
    if bare:
        chosen = None if surfaces is None else [surfaces[i] for i in bare]
        made = _smoothed([meshes[i] for i in bare], float(np.cos(np.radians(crease_degrees))), chosen)
        for i, mesh in zip(bare, made, strict=True):
            found[i] = mesh
    return found


def _smoothed(meshes: list[Mesh], limit: float, surfaces: list[int | I32] | None) -> Iterator[Mesh]:
    for mesh in meshes:
        if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.positions):
            raise IndexError(f"a triangle of {mesh.name} names a vertex that is not there")
    offset = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    begin = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)])
    positions = read_only(_joined([split_offset(mesh.positions)[0] for mesh in meshes]).astype(np.float32, copy=False))
    triangles = [mesh.triangles.astype(np.int32, copy=False) for mesh in meshes]
    triangle = read_only(_joined([each + np.int32(at) if at else each for each, at in zip(triangles, offset, strict=False)]))
    corners = triangle.reshape(-1)
    # Vertices that differ in UV or colour alone are one point of the surface.
    first, number = unique_threes(positions + np.float32(0))  # turns -0 into 0
    place, at_corner = number, triangle
    if surfaces is not None and all(isinstance(each, int) for each in surfaces):
        if len({*surfaces}) > 1:
            surface = np.repeat(np.asarray(surfaces, np.int32), np.diff(offset))
            _, place = unique_threes(np.column_stack([number, surface, np.zeros_like(surface)]))
    elif surfaces is not None:
        many = [len(mesh.triangles) for mesh in meshes]
        of = [np.broadcast_to(np.asarray(each, np.int32), count) for each, count in zip(surfaces, many, strict=True)]
        surface = np.repeat(_joined(of), 3)
        _, place = unique_threes(np.column_stack([number[corners], surface, np.zeros_like(surface)]))
        at_corner = np.arange(triangle.size, dtype=np.int32).reshape(-1, 3)
    if len(meshes) > 1:
        owner = np.repeat(np.arange(len(meshes), dtype=np.int32), np.diff(offset))
        first, number = unique_threes(np.column_stack([number, owner, np.zeros_like(owner)]))
    if surfaces is None:
        place = number
    count = triangle.size
    start, order = np.zeros(int(place.max()) + 2, np.int64), np.empty(count, np.int64)
    sort_corners(at_corner, place, start, order)
    unit, across, along = np.empty((len(triangle), 3)), np.empty(count), np.empty(count)
    measure_corners(positions, triangle, unit, across, along)
    angle = np.arctan2(across, along, out=along)
    angle *= across > 0

    # Corners with equal vertex and normal remain one vertex.
    vertex = first[number[corners]]
    for mesh, a, b in zip(meshes, begin.tolist(), begin[1:].tolist(), strict=False):
        if any(values is not None for values in (mesh.uvs, mesh.uvs1, mesh.colors)):
            vertex[3 * a : 3 * b] = corners[3 * a : 3 * b]
    kind, kept = np.full(count, -1, np.int32), np.empty(count, np.int32)
    normal = np.empty((count, 3), np.float32)
    kept = kept[: round_corners(unit, angle, start, order, vertex, limit, MAX_VALENCE, normal, kind, kept)]
    mesh_of = np.searchsorted(begin, kept // 3, "right") - 1
    if surfaces is not None and len(meshes) > 1:  # points of several meshes: group their vertices
        sorting = np.argsort(mesh_of, kind="stable")
        rank = np.empty(len(kept), np.int32)
        rank[sorting] = np.arange(len(kept), dtype=np.int32)
        normal[: len(kept)] = normal[sorting]
        kept, mesh_of, kind = kept[sorting], mesh_of[sorting], rank[kind]
    shown = vertex[kept]
    ends = np.searchsorted(mesh_of, np.arange(len(meshes) + 1))
    for i, (mesh, a, b) in enumerate(zip(meshes, ends.tolist(), ends[1:].tolist(), strict=False)):
        own = shown[a:b] - np.int32(offset[i])
        uvs, uvs1, colors = (None if values is None else values[own] for values in (mesh.uvs, mesh.uvs1, mesh.colors))
        numbers = kind[3 * begin[i] : 3 * begin[i + 1]].reshape(-1, 3)
        numbers = numbers - np.int32(a) if a else numbers
        yield Mesh(mesh.name, mesh.positions[own], numbers, normal[a:b], uvs, mesh.material, uvs1, colors)


def _joined(arrays: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def corner_angles(positions: F32, triangles: I32) -> F64:
    """Returns the angles at the corners of triangles, (T, 3) in radians; 0 for triangles without area."""
    corners = positions[triangles].astype(np.float64)
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    return np.arctan2(across, np.einsum("tkc,tkc->tk", to_next, to_last)) * (across > 0)
