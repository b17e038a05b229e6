"""Transforms one mesh into another space: its vertices with all attributes that the kernel reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.kernel.mesh.faces import find_solid
from renderer.kernel.mesh.vertices import place_normals, place_points
from renderer.scene.curve_meshes import has_curves
from renderer.scene.description import F32, I32, Mesh, SceneDescription
from renderer.scene.kernel_arguments import read_only
from renderer.scene.matrices import product
from renderer.scene.normals import cofactors, face_normals
from renderer.scene.tangents import needs_tangents, split_mirrored, tangent_uv_set, vertex_tangents
from renderer.sentences import Sentence
from renderer.threads import PART, Team, parts_of

__all__ = ["MAX_COORDINATE", "Placed", "finite", "placed", "with_keys"]

MAX_COORDINATE = 1e15  # squares and products of coordinates stay within float32
_NO_KEYS = np.zeros((0, 2, 0, 3), np.float32)
_NO_DIAMETER = np.float32(1e-30)
_ANY = (0.0, 1.0, 0.0)  # the normal of degenerate vertices


class Placed(NamedTuple):
    """A placed mesh: V vertices and T triangles, as in CompiledScene."""

    position: F32  # (V, 3)
    normal: F32  # (V, 3), unit
    uv: F32  # (V, 2)
    uv1: F32  # (V or 0, 2)
    color: F32  # (V or 0, 4)
    tangent: F32  # (V or 0, 4)
    triangle: I32  # (T, 3)
    dropped: int  # number of triangles without area that were removed
    vertex: slice | npt.NDArray[np.int64] = slice(None)  # (V,) each vertex's index in the mesh
    keys: F32 = _NO_KEYS  # (K or 0, 2, V, 3): positions and unit normals while the shutter is open


def placed(
    description: SceneDescription,
    mesh: Mesh,
    transform: npt.NDArray[np.float64],
    materials: list[int],
    team: Team,
    whole: bool = False,
) -> Placed:
    """Returns a mesh transformed by `transform`, with all attributes that the kernel reads.

    materials: indices of all materials that the mesh may be shown with; they decide whether it has tangents. whole: keeps
    triangles without area, so that the number of triangles is the same in every frame. Raises SceneError if a position exceeds
    the range of float32.
    """
    transform = np.ascontiguousarray(transform, np.float64)
    position = _placed_points(mesh, transform, team)
    triangle = read_only(mesh.triangles.astype(np.int32, copy=False))
    mirrors = bool(np.linalg.det(transform[:3, :3]) < 0)
    if mirrors:
        triangle = read_only(triangle[:, [0, 2, 1]])
    curves = has_curves(mesh)
    solid = np.empty(len(triangle), bool)
    with_area = team.each(lambda part: find_solid(position, triangle, *part, solid), parts_of(0, len(triangle), PART))
    dropped = 0 if whole or curves else len(triangle) - sum(with_area)
    if dropped:
        triangle = np.ascontiguousarray(triangle[solid])
    elif whole and not curves:
        triangle = _without_segments(triangle)
    # Each vertex's index in the mesh, so that attributes can be copied when vertices are split.
    vertex: slice | npt.NDArray[np.int64] = slice(None)
    if mesh.normals is None:  # flat: no vertex is shared, each has its face's normal
        face = face_normals(position, triangle)
        vertex = triangle.reshape(-1).astype(np.int64)
        normal = np.repeat(_unit(face), 3, axis=0)
        triangle = np.arange(len(vertex), dtype=np.int32).reshape(-1, 3)
    else:
        normal = _placed_normals(mesh.normals, transform, position, triangle, team)
    tangent = np.zeros((0, 4), np.float32)
    bent = [description.materials[m] for m in materials if needs_tangents(description.materials[m])]
    if (bent or curves) and mesh.tangents is not None and mesh.normals is not None:
        tangent = _transform_tangents(mesh.tangents, transform, mirrors)
    elif bent:
        uvs = mesh.uvs1 if tangent_uv_set(description, bent[0]) else mesh.uvs
        uv = finite(uvs, len(mesh.positions), 2)[vertex]
        kept, triangle = split_mirrored(uv, triangle)
        vertex, normal = np.arange(len(position))[vertex][kept], normal[kept]
        tangent = vertex_tangents(position[vertex], normal, uv[kept], triangle)
    if curves or any(material.kind == "hair" for material in bent):
        tangent[:, 3] *= _placed_diameters(mesh, transform)[vertex]
    if curves:  # mirrored instances flip the sign; here, curves themselves are mirrored
        tangent[:, 3] = np.abs(tangent[:, 3])
    none = np.zeros((0, 4), np.float32)
    return Placed(
        position[vertex],
        normal,
        finite(mesh.uvs, len(mesh.positions), 2)[vertex],
        none[:, :2] if mesh.uvs1 is None else finite(mesh.uvs1, len(mesh.positions), 2)[vertex],
        none if mesh.colors is None else np.clip(finite(mesh.colors, len(mesh.positions), 4), 0, 1)[vertex],
        tangent,
        triangle,
        dropped,
        vertex,
    )


def with_keys(found: Placed, mesh: Mesh, transforms: Sequence[npt.NDArray[np.float64]], team: Team) -> Placed:
    """Returns a mesh from `placed` with its vertices at the shutter's keys added.

    transforms: one per key. They are applied to the mesh's own keys if it has any, else to its only shape.
    """
    shapes = mesh.keys or ((mesh.positions, mesh.normals),) * len(transforms)
    keys = np.empty((len(transforms), 2, *found.position.shape), np.float32)
    for key, (positions, normals), transform in zip(keys, shapes, transforms, strict=True):
        shape, place = replace(mesh, positions=positions, normals=normals), np.ascontiguousarray(transform, np.float64)
        position = _placed_points(shape, place, team)
        key[0] = position[found.vertex]
        if normals is None:
            face = face_normals(key[0], found.triangle)
            key[1, found.triangle.reshape(-1)] = np.repeat(_unit(face), 3, axis=0)
        else:
            triangle = read_only(mesh.triangles.astype(np.int32, copy=False))
            key[1] = _placed_normals(normals, place, position, triangle, team)[found.vertex]
    return found._replace(keys=keys)


def _without_segments(triangle: I32) -> I32:
    """Returns the triangles with corners (b, b, b) in place of (a, b, b), which would be a segment of a curve."""
    segments = (triangle[:, 1] == triangle[:, 2]) & (triangle[:, 0] != triangle[:, 1])
    if not segments.any():
        return triangle
    triangle = triangle.copy()
    triangle[segments, 0] = triangle[segments, 1]
    return triangle


def _unit(face: npt.NDArray[np.float64]) -> F32:
    length = np.linalg.norm(face, axis=1)[:, None]
    return np.divide(face, length, out=np.tile(_ANY, (len(face), 1)), where=length > 0).astype(np.float32)


def finite(values: np.ndarray | None, count: int, width: int) -> F32:
    """Returns values as (count, width) float32. Missing values (None) and non-finite ones become 0."""
    if values is None:
        return np.zeros((count, width), np.float32)
    if not np.isfinite(values).all():
        values = np.where(np.isfinite(values), values, 0)
    return np.asarray(values, np.float32)


def _placed_points(mesh: Mesh, transform: npt.NDArray[np.float64], team: Team) -> F32:
    """Returns the mesh's positions in world space."""
    point = read_only(mesh.positions.astype(np.float32, copy=False))
    placed = np.empty((len(point), 3), np.float32)
    largest = team.each(lambda part: place_points(point, transform, *part, placed), parts_of(0, len(point), PART))
    if not all(each <= MAX_COORDINATE for each in largest):
        raise SceneError(
            Sentence(
                "mesh-out-of-number-range",
                "Mesh {name}: its position is too large for 32-bit numbers; correct its transform",
                name=mesh.name,
            )
        )
    return read_only(placed)


def _placed_normals(normals: F32, transform: npt.NDArray[np.float64], position: F32, triangle: I32, team: Team) -> F32:
    """Returns a mesh's unit normals in world space.

    Normals of length zero, which occur in files, are replaced by those of the adjacent faces.
    """
    own, matrix = read_only(normals.astype(np.float32, copy=False)), np.ascontiguousarray(cofactors(transform))
    placed, length = np.empty((len(own), 3), np.float32), np.empty(len(own))
    team.each(lambda part: place_normals(own, matrix, *part, placed, length), parts_of(0, len(own), PART))
    most = float(np.max(length, initial=0, where=np.isfinite(length)))
    bad = np.flatnonzero(~(np.isfinite(length) & (length > 1e-12 * max(most, 1e-300))))
    if len(bad):
        around = np.zeros((len(own), 3))
        face = face_normals(position, triangle)
        for k in range(3):
            np.add.at(around, triangle[:, k], face)
        around = around[bad]
        size = np.linalg.norm(around, axis=1, keepdims=True)
        placed[bad] = np.divide(around, size, out=np.tile(_ANY, (len(bad), 1)), where=size > 0)
    return placed


def _placed_diameters(mesh: Mesh, transform: npt.NDArray[np.float64]) -> F32:
    """Returns the diameters of a mesh's fibres after a transform, (V,), above 0; a tiny one where it has no fibres."""
    if mesh.diameters is None:
        return np.full(len(mesh.positions), _NO_DIAMETER)
    scale = abs(float(np.linalg.det(transform[:3, :3]))) ** (1 / 3)
    return np.maximum(mesh.diameters * np.float32(scale), _NO_DIAMETER)


def _transform_tangents(tangents: F32, transform: np.ndarray, mirrors: bool) -> F32:
    """Returns a file's tangents (V, 4) in world space.

    mirrors: the transform is a reflection. The sign in w is then flipped, since the normal stays on the same side.
    """
    direction = product(finite(tangents, len(tangents), 4)[:, None, :3].astype(np.float64), transform[:3, :3].T)[:, 0]
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = np.divide(direction, length, out=np.tile([[1.0, 0.0, 0.0]], (len(direction), 1)), where=length > 0)
    sign = np.where((tangents[:, 3] < 0) != mirrors, -1.0, 1.0)
    return np.column_stack([unit, sign]).astype(np.float32)
