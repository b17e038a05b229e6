"""All instances as one list of triangles in world space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Instance, Mesh, SceneDescription
from renderer.scene.normals import cofactors, face_normals

__all__ = ["MAX_COORDINATE", "MAX_TRIANGLES", "Geometry", "flatten"]

MAX_TRIANGLES = 20_000_000
MAX_COORDINATE = 1e15  # squares and products of it stay within float32


class Geometry(NamedTuple):
    """World-space triangles, as in CompiledScene; `dropped` counts those that had no area."""

    position: F32  # (V, 3)
    normal: F32  # (V, 3), unit
    uv: F32  # (V, 2)
    triangle: I32  # (T, 3)
    triangle_material: I32  # (T,)
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
    parts = [_place(description.meshes[i.mesh], i) for i in description.instances]
    if not parts:
        empty = np.zeros((0, 3), np.float32)
        return Geometry(empty, empty, np.zeros((0, 2), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, np.int32), 0)
    first = np.cumsum([0] + [len(p.position) for p in parts])
    return Geometry(
        np.concatenate([p.position for p in parts]),
        np.concatenate([p.normal for p in parts]),
        np.concatenate([p.uv for p in parts]),
        np.concatenate([p.triangle + np.int32(f) for p, f in zip(parts, first, strict=False)]),
        np.concatenate([p.triangle_material for p in parts]),
        sum(p.dropped for p in parts),
    )


def _place(mesh: Mesh, instance: Instance) -> Geometry:
    transform = np.asarray(instance.transform, np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        position = (mesh.positions @ transform[:3, :3].T + transform[:3, 3]).astype(np.float32)
    if not np.isfinite(position).all() or np.abs(position).max(initial=0) > MAX_COORDINATE:
        raise SceneError(f"Mesh {mesh.name}: its place in the world is beyond what numbers hold; give it a sane transform")
    triangle = np.ascontiguousarray(mesh.triangles, np.int32)
    if np.linalg.det(transform[:3, :3]) < 0:
        triangle = np.ascontiguousarray(triangle[:, [0, 2, 1]])
    face = face_normals(position, triangle)
    area = np.linalg.norm(face, axis=1)
    solid = area > 0
    dropped = int(len(solid) - np.count_nonzero(solid))
    if dropped:
        triangle, face, area = np.ascontiguousarray(triangle[solid]), face[solid], area[solid]
    uv = mesh.uvs if mesh.uvs is not None else np.zeros((len(position), 2), np.float32)
    uv = np.where(np.isfinite(uv), uv, 0).astype(np.float32)
    if mesh.normals is None:  # flat: no vertex is shared, each has its face's normal
        corners = triangle.reshape(-1)
        position, uv = position[corners], uv[corners]
        normal = np.repeat((face / area[:, None]).astype(np.float32), 3, axis=0)
        triangle = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    else:
        normal = _unit_normals(mesh.normals.astype(np.float64) @ cofactors(transform).T, triangle, face)
    material = np.full(len(triangle), mesh.material if instance.material is None else instance.material, np.int32)
    return Geometry(position, normal, np.ascontiguousarray(uv), triangle, material, dropped)


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
