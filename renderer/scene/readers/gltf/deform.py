"""Morph targets and skins (specification 3.7.2.2 and 3.7.3.3): meshes as their weights and joints shape them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Mesh
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.transforms import Matrix

__all__ = ["Bones", "bind_matrices", "morphed", "skinned"]


class Bones(NamedTuple):
    """What moves a primitive's vertices."""

    joints: npt.NDArray[np.int64]  # (V, 4 k)
    weights: F32  # (V, 4 k)


def morphed(mesh: Mesh, targets: list[Json], weights: tuple[float, ...], accessors: Accessors) -> Mesh:
    """The mesh plus its targets' displacements by their weights. Raises SceneError where one has another length."""
    positions, normals, tangents = mesh.positions, mesh.normals, mesh.tangents
    for target, weight in zip(targets, weights, strict=False):
        if weight == 0:
            continue
        moved = _displacement(target, "POSITION", len(mesh.positions), accessors)
        turned = _displacement(target, "NORMAL", len(mesh.positions), accessors)
        bent = _displacement(target, "TANGENT", len(mesh.positions), accessors)
        scale = np.float32(weight)
        positions = positions if moved is None else positions + scale * moved
        normals = normals if normals is None or turned is None else normals + scale * turned
        if tangents is not None and bent is not None:
            tangents = np.column_stack([tangents[:, :3] + scale * bent, tangents[:, 3]])
    return replace(mesh, positions=positions, normals=normals, tangents=tangents)


def _displacement(target: Json, key: str, count: int, accessors: Accessors) -> F32 | None:
    at = target.index(key, accessors.accessors)
    if at is None:
        return None
    values = accessors.floats(at, 3)
    if len(values) != count:
        raise target.wrong(key, f"has {len(values)} displacements of {count} vertices")
    return values


def bind_matrices(skin: Json, count: int, accessors: Accessors) -> Matrix:
    """(count, 4, 4): from the mesh's space into that of each joint."""
    at = skin.index("inverseBindMatrices", accessors.accessors)
    if at is None:
        return np.tile(np.eye(4), (count, 1, 1))
    values = accessors.floats(at, 16)
    if len(values) < count:
        raise skin.wrong("inverseBindMatrices", f"has {len(values)} matrices for {count} joints")
    return values[:count].astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)  # column-major


def skinned(mesh: Mesh, bones: Bones, matrices: Matrix) -> Mesh:
    """The mesh in the world: each vertex moved by the mean of its joints' (J, 4, 4) matrices, by weight."""
    weights = bones.weights.astype(np.float64)
    total = np.zeros((len(weights), 1))
    for k in range(weights.shape[1]):
        total[:, 0] += weights[:, k]
    weights = np.divide(weights, total, out=np.zeros(weights.shape), where=total > 0)
    blend = np.zeros((len(mesh.positions), 3, 4))
    for k in range(weights.shape[1]):
        used = np.flatnonzero(weights[:, k])
        blend[used] += weights[used, k, None, None] * matrices[bones.joints[used, k], :3]
    loose = np.flatnonzero(total[:, 0] <= 0)
    blend[loose] = np.eye(4)[:3]
    linear = blend[:, :, :3]
    positions = _carried(linear, mesh.positions) + blend[:, :, 3]
    result = replace(mesh, positions=positions.astype(np.float32))
    if mesh.normals is not None:
        x, y, z = linear[:, :, 0], linear[:, :, 1], linear[:, :, 2]
        cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
        result.normals = _carried(cofactors, mesh.normals).astype(np.float32)
    if mesh.tangents is not None:
        tangents = _carried(linear, mesh.tangents[:, :3])
        result.tangents = np.column_stack([tangents, mesh.tangents[:, 3]]).astype(np.float32)
    return result


def _carried(matrices: Matrix, vectors: F32) -> Matrix:
    """(V, 3): each vector through its (3, 3) matrix. Not by einsum, whose sums are rounded as the processor likes it."""
    x, y, z = (vectors[:, k, None].astype(np.float64) for k in range(3))
    return (matrices[:, :, 0] * x + matrices[:, :, 1] * y) + matrices[:, :, 2] * z
