"""Tangents: the direction on the surface in which a texture's u increases, used by normal maps and anisotropy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32, Material, SceneDescription
from renderer.scene.normals import corner_angles

__all__ = ["has_elliptic_fibres", "needs_tangents", "split_mirrored", "tangent_uv_set", "vertex_tangents"]

F64 = npt.NDArray[np.float64]


def needs_tangents(material: Material) -> bool:
    """Returns True if the material depends on tangents: it has a normal map, or is anisotropic, or hair."""
    if material.kind == "hair":
        return True
    return material.normal_texture is not None or material.clearcoat_normal_texture is not None or material.anisotropy != 0.0


def has_elliptic_fibres(description: SceneDescription) -> bool:
    """Returns True if there is hair with an elliptic cross-section, the normals of which are in the second UV set."""
    return any(material.aspect_ratio < 1 for material in description.materials)


def tangent_uv_set(description: SceneDescription, material: Material) -> int:
    """Returns the UV set, 0 or 1, that the tangents follow: the normal map's."""
    for number in (material.normal_texture, material.clearcoat_normal_texture, material.anisotropy_texture):
        if number is not None:
            return description.textures[number].uv_set
    return 0


def _handedness(uv: F32, triangle: I32) -> F64:
    """Returns twice the signed area of each triangle in texture space, (T,).

    It is positive if the image appears mirrored on the triangle. As in glTF, v points downwards.
    """
    a, b, c = (uv[triangle[:, k]].astype(np.float64) for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])


def split_mirrored(uv: F32, triangle: I32) -> tuple[npt.NDArray[np.int64], I32]:
    """Splits vertices that are shared by triangles with mirrored and unmirrored texture, whose tangents would cancel.

    Returns the original vertex of each new one, and the triangles over the new vertices.
    """
    count = len(uv)
    mirrored = np.repeat(_handedness(uv, triangle) > 0, 3)
    corner = triangle.reshape(-1).astype(np.int64)
    straight = np.zeros(count, bool)
    straight[corner[~mirrored]] = True
    both = np.zeros(count, bool)
    both[corner[mirrored]] = True
    both &= straight
    if not both.any():
        return np.arange(count), triangle
    copy = np.full(count, -1, np.int64)
    copy[both] = count + np.arange(np.count_nonzero(both))
    moved = mirrored & both[corner]
    corner = np.where(moved, copy[corner], corner)
    return np.concatenate([np.arange(count), np.flatnonzero(both)]), corner.reshape(-1, 3).astype(np.int32)


def vertex_tangents(position: F32, normal: F32, uv: F32, triangle: I32) -> F32:
    """Returns (V, 4) unit tangents, perpendicular to the normals, with the sign of the bitangent in w.

    cross(normal, tangent) * w points to the image's top. Each triangle's tangent is projected into the plane perpendicular to the
    vertex normal and weighted by the triangle's angle there, as in MikkTSpace (Mikkelsen, "Simulation of Wrinkled Surfaces
    Revisited", 2008). The direction is arbitrary where the UVs are constant.
    """
    area = _handedness(uv, triangle)
    a, b, c = (position[triangle[:, k]].astype(np.float64) for k in range(3))
    v0, v1, v2 = (uv[triangle[:, k], 1].astype(np.float64) for k in range(3))
    face = (v2 - v0)[:, None] * (b - a) - (v1 - v0)[:, None] * (c - a)
    face *= np.sign(area)[:, None]
    corner = triangle.reshape(-1)
    n = normal.astype(np.float64)
    flat = np.repeat(face, 3, axis=0)
    flat -= n[corner] * np.einsum("ij,ij->i", n[corner], flat)[:, None]
    flat = _unit(flat) * corner_angles(position, triangle).reshape(-1, 1)
    columns: list[npt.NDArray[Any]] = [np.bincount(corner, flat[:, k], len(position)) for k in range(3)]
    total: F64 = np.stack(columns, axis=1)
    sign = np.bincount(corner, np.repeat(np.sign(area), 3), len(position))
    tangent = _unit(total)
    lost = ~tangent.any(axis=1)
    tangent[lost] = _any_tangent(n[lost])
    return np.column_stack([tangent, np.where(sign > 0, -1.0, 1.0)]).astype(np.float32)


def _unit(v: F64) -> F64:
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.divide(v, length, out=np.zeros(v.shape), where=length > 0)  # bincount of nothing gives integers


def _any_tangent(n: F64) -> F64:
    axis = np.where(np.abs(n[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    return _unit(axis - n * np.einsum("ij,ij->i", n, axis)[:, None])
