"""All instances as one list of triangles in world space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Instance, Mesh, SceneDescription
from renderer.scene.normals import cofactors, face_normals
from renderer.scene.objects import number_objects
from renderer.scene.tangents import needs_tangents, split_mirrored, tangent_uv_set, vertex_tangents

__all__ = ["MAX_COORDINATE", "MAX_TRIANGLES", "Geometry", "flatten"]

MAX_TRIANGLES = 20_000_000
MAX_COORDINATE = 1e15  # squares and products of it stay within float32


class Geometry(NamedTuple):
    """World-space triangles, as in CompiledScene; `dropped` counts those that had no area."""

    position: F32  # (V, 3)
    normal: F32  # (V, 3), unit
    uv: F32  # (V, 2)
    uv1: F32  # (V or 0, 2)
    color: F32  # (V or 0, 4)
    tangent: F32  # (V or 0, 4)
    triangle: I32  # (T, 3)
    triangle_material: I32  # (T,)
    triangle_object: I32  # (T,)
    dropped: int


def flatten(description: SceneDescription) -> Geometry:
    """Places every instance. Raises SceneError where a scene has more than MAX_TRIANGLES or leaves the range of float32."""
    shown = [description.meshes[i.mesh] for i in description.instances]
    for total, limit, what in (
        (sum(len(m.triangles) for m in shown), MAX_TRIANGLES, "triangles"),
        (sum(len(m.positions) for m in shown), 3 * MAX_TRIANGLES, "vertices"),
    ):
        if total > limit:
            raise SceneError(
                f"{description.name}: shows {total / 1e6:.0f} million {what}; at most {limit // 10**6} million fit. "
                "Simplify its meshes or show fewer instances"
            )
    parts = [
        _place(description, description.meshes[i.mesh], i, number)
        for i, number in zip(description.instances, number_objects(description).instance, strict=True)
    ]
    return _joined(parts)


def _joined(parts: list[Geometry]) -> Geometry:
    """The parts as one. What only some of them have (uv1, color, tangent) the others get neutral values for."""
    first = np.cumsum([0] + [len(p.position) for p in parts])
    vertices = int(first[-1])

    def together(name: str, width: int, neutral: float) -> F32:
        arrays = [getattr(p, name) for p in parts]
        if not any(len(a) for a in arrays):
            return np.zeros((0, width), np.float32)
        whole = np.full((vertices, width), neutral, np.float32)
        for at, array in zip(first, arrays, strict=False):
            whole[at : at + len(array)] = array
        return whole

    triangles = [np.zeros((0, 3), np.int32)] + [p.triangle + np.int32(f) for p, f in zip(parts, first, strict=False)]
    none = [np.zeros(0, np.int32)]
    return Geometry(
        together("position", 3, 0.0),
        together("normal", 3, 0.0),
        together("uv", 2, 0.0),
        together("uv1", 2, 0.0),
        together("color", 4, 1.0),
        together("tangent", 4, 0.0),
        np.concatenate(triangles),
        np.concatenate(none + [p.triangle_material for p in parts]),
        np.concatenate(none + [p.triangle_object for p in parts]),
        sum(p.dropped for p in parts),
    )


def _place(description: SceneDescription, mesh: Mesh, instance: Instance, number: int) -> Geometry:
    transform = np.asarray(instance.transform, np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        position = (mesh.positions @ transform[:3, :3].T + transform[:3, 3]).astype(np.float32)
    if not np.isfinite(position).all() or np.abs(position).max(initial=0) > MAX_COORDINATE:
        raise SceneError(f"Mesh {mesh.name}: its place in the world is beyond what numbers hold; give it a sane transform")
    triangle = np.ascontiguousarray(mesh.triangles, np.int32)
    mirrors = bool(np.linalg.det(transform[:3, :3]) < 0)
    if mirrors:
        triangle = np.ascontiguousarray(triangle[:, [0, 2, 1]])
    face = face_normals(position, triangle)
    area = np.linalg.norm(face, axis=1)
    solid = area > 0
    dropped = int(len(solid) - np.count_nonzero(solid))
    if dropped:
        triangle, face, area = np.ascontiguousarray(triangle[solid]), face[solid], area[solid]
    # Each vertex's number in the mesh: the attributes follow wherever vertices are split.
    if mesh.normals is None:  # flat: no vertex is shared, each has its face's normal
        vertex = triangle.reshape(-1).astype(np.int64)
        normal = np.repeat((face / area[:, None]).astype(np.float32), 3, axis=0)
        triangle = np.arange(len(vertex), dtype=np.int32).reshape(-1, 3)
    else:
        vertex = np.arange(len(position))
        normal = _unit_normals(mesh.normals.astype(np.float64) @ cofactors(transform).T, triangle, face)
    number_of_material = mesh.material if instance.material is None else instance.material
    tangent = np.zeros((0, 4), np.float32)
    if needs_tangents(description.materials[number_of_material]):
        if mesh.tangents is not None and mesh.normals is not None:
            tangent = _carried_tangents(mesh.tangents, transform, mirrors)
        else:
            uvs = mesh.uvs1 if tangent_uv_set(description, description.materials[number_of_material]) else mesh.uvs
            uv = _finite(uvs, len(mesh.positions), 2)[vertex]
            kept, triangle = split_mirrored(uv, triangle)
            vertex, normal = vertex[kept], normal[kept]
            tangent = vertex_tangents(position[vertex], normal, uv[kept], triangle)
    none = np.zeros((0, 4), np.float32)
    return Geometry(
        position[vertex],
        normal,
        _finite(mesh.uvs, len(mesh.positions), 2)[vertex],
        none[:, :2] if mesh.uvs1 is None else _finite(mesh.uvs1, len(mesh.positions), 2)[vertex],
        none if mesh.colors is None else np.clip(_finite(mesh.colors, len(mesh.positions), 4), 0, 1)[vertex],
        tangent,
        triangle,
        np.full(len(triangle), number_of_material, np.int32),
        np.full(len(triangle), number, np.int32),
        dropped,
    )


def _finite(values: np.ndarray | None, count: int, width: int) -> F32:
    """(count, width) float32: zeros where there are no values, and for those that are no numbers."""
    if values is None:
        return np.zeros((count, width), np.float32)
    return np.where(np.isfinite(values), values, 0).astype(np.float32)


def _carried_tangents(tangents: F32, transform: np.ndarray, mirrors: bool) -> F32:
    """A file's tangents in the world. Mirrored, the frame changes hands: the normal keeps its side, the tangent turns."""
    direction = _finite(tangents, len(tangents), 4)[:, :3] @ transform[:3, :3].T
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = np.divide(direction, length, out=np.tile([[1.0, 0.0, 0.0]], (len(direction), 1)), where=length > 0)
    sign = np.where((tangents[:, 3] < 0) != mirrors, -1.0, 1.0)
    return np.column_stack([unit, sign]).astype(np.float32)


def _unit_normals(normal: np.ndarray, triangle: I32, face: np.ndarray) -> F32:
    length = np.linalg.norm(normal, axis=1)
    good = np.isfinite(length) & (length > 1e-12 * max(float(np.max(length, initial=0, where=np.isfinite(length))), 1e-300))
    if not good.all():  # files do hold zero normals: the faces around the vertex stand in
        around = np.zeros_like(normal)
        for k in range(3):
            np.add.at(around, triangle[:, k], face)
        around[np.linalg.norm(around, axis=1) == 0] = (0.0, 1.0, 0.0)
        normal = np.where(good[:, None], normal, around)
        length = np.linalg.norm(normal, axis=1)
    return (normal / length[:, None]).astype(np.float32)
