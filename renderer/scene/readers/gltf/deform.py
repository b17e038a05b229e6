"""Applies morph targets and skins to meshes (specification 3.7.2.2 and 3.7.3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Mesh
from renderer.scene.kernel_arguments import read_only
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.gltf.transforms import Matrix
from renderer.scene.readers.skinning import carried
from renderer.sentences import Sentence

__all__ = ["Bones", "bind_matrices", "morphed", "skinned"]


class Bones(NamedTuple):
    """The joint indices and weights of a primitive's vertices."""

    joints: npt.NDArray[np.int64]  # (V, 4 k)
    weights: F32  # (V, 4 k)


def morphed(mesh: Mesh, targets: list[Json], weights: tuple[float, ...], accessors: Accessors) -> Mesh:
    """Returns the mesh plus the weighted displacements of its morph targets; unusable targets are left out."""
    positions, normals, tangents = mesh.positions, mesh.normals, mesh.tangents
    for target, weight in zip(targets, weights, strict=False):
        if weight == 0:
            continue
        for key in target.value:
            if key.startswith(("TEXCOORD_", "COLOR_")):
                target.fault(
                    key,
                    Sentence(
                        "gltf-morph-attribute-unsupported",
                        "displaces texture coordinates or colours, which is not supported",
                    ),
                )
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
    try:
        values = accessors.floats(at, 3)
    except DamagedError as fault:
        target.faults.add(fault)
        return None
    if len(values) != count:
        target.fault(
            key,
            Sentence("gltf-morph-count-wrong", "has {found} displacements for {count} vertices", found=len(values), count=count),
        )
        return None
    return values


def bind_matrices(skin: Json, count: int, accessors: Accessors) -> Matrix:
    """Returns (count, 4, 4) transforms from mesh space to the space of each joint. Raises DamagedError if there are too few."""
    if "inverseBindMatrices" not in skin:
        return np.tile(np.eye(4), (count, 1, 1))
    values = accessors.floats(skin.integer("inverseBindMatrices", high=len(accessors.accessors)), 16)
    if len(values) < count:
        raise skin.damage(
            "inverseBindMatrices",
            Sentence(
                "gltf-joint-matrix-count-wrong", "has {matrices} matrices for {joints} joints", matrices=len(values), joints=count
            ),
        )
    return values[:count].astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)  # column-major


def skinned(mesh: Mesh, bones: Bones, matrices: Matrix) -> Mesh:
    """Returns the mesh in world space. Each vertex is transformed by the weighted mean of its joints' (J, 4, 4) matrices."""
    none = np.zeros((0, 3), np.float32)
    normals = none if mesh.normals is None else mesh.normals
    tangents = none if mesh.tangents is None else mesh.tangents
    turned, bent = np.empty(normals.shape, np.float32), none
    if mesh.tangents is not None:
        bent = mesh.tangents.astype(np.float32)  # the last column (handedness) is unchanged
    arrays = (matrices, bones.joints, bones.weights, mesh.positions, normals, tangents)
    placed = carried(*(read_only(array) for array in arrays), turned=turned, bent=bent)
    result = replace(mesh, positions=placed)
    if mesh.normals is not None:
        result.normals = turned
    if mesh.tangents is not None:
        result.tangents = bent
    return result
