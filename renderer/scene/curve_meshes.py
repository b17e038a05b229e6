"""Meshes of curves, whose triangles (a, b, b) are segments of round curves (renderer/bvh/curves.py), as wide as their diameters.

Kernels intersect such segments if the material is hair, or the curves are flat. Others, and those in previews, become tubes of
triangles.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription
from renderer.scene.frame_reuse import ShotCache

__all__ = ["flat_materials", "has_curves", "round_tubes", "with_tubes"]

_SIDES = 6


def has_curves(mesh: Mesh) -> bool:
    """Returns True if a mesh consists of segments of curves."""
    corner = mesh.triangles
    return mesh.diameters is not None and len(corner) > 0 and bool((corner[:, 1] == corner[:, 2]).all())


def round_tubes(mesh: Mesh, sides: int = _SIDES) -> Mesh:
    """Returns a mesh of curves as open tubes, one for each segment, with the curves' attributes and motion keys.

    A tube is as wide on average as the round curve.
    """
    assert mesh.diameters is not None
    ends = mesh.triangles[:, :2].astype(np.int64)
    vertex = np.repeat(ends.reshape(-1), sides)
    angle = np.arange(sides) * (2 * np.pi / sides)
    widened = np.pi / sides / np.sin(np.pi / sides)
    radius = np.asarray(mesh.diameters, np.float64)[vertex, None] / 2 * widened

    def rings(positions: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], F32]:
        """Returns the (n, 3) positions and normals of the tubes around curves with these positions."""
        a, b = (positions[ends[:, k]].astype(np.float64) for k in (0, 1))
        along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-30)
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
        out = across[:, None] * np.cos(angle)[:, None] + np.cross(along, across)[:, None] * np.sin(angle)[:, None]
        normals = np.repeat(out, 2, axis=0).reshape(-1, 3)
        return (positions[vertex] + radius * normals).astype(positions.dtype), normals.astype(np.float32)

    k, first = np.arange(sides), 2 * sides * np.arange(len(ends))[:, None]
    a, b = first + k, first + (k + 1) % sides
    triangles = np.concatenate([np.stack(each, axis=-1) for each in ((a, b, b + sides), (a, b + sides, a + sides))], axis=1)
    positions, normals = rings(mesh.positions)
    uvs, uvs1, colors, tangents = (None if a is None else a[vertex] for a in (mesh.uvs, mesh.uvs1, mesh.colors, mesh.tangents))
    return replace(
        mesh,
        positions=positions,
        triangles=triangles.reshape(-1, 3).astype(np.int32),
        normals=normals,
        diameters=(2 * radius[:, 0]).astype(np.float32),
        keys=tuple(rings(shape) for shape, _ in mesh.keys),
        uvs=uvs,
        uvs1=uvs1,
        colors=colors,
        tangents=tangents,
    )


def with_tubes(description: SceneDescription, shot_cache: ShotCache) -> SceneDescription:
    """Returns the description with tubes for instances of curves that are neither hair nor flat, or that emit light."""
    places: dict[int, int] = {}
    meshes, instances = list(description.meshes), list(description.instances)
    for number, instance in enumerate(instances):
        mesh = description.meshes[instance.mesh]
        if mesh.diameters is None or not has_curves(mesh):
            continue
        material = description.materials[_material_of(description, instance)]
        if not _emits(material) and (mesh.flat or material.kind == "hair"):
            continue
        if instance.mesh not in places:
            places[instance.mesh] = len(meshes)
            made = shot_cache.get_or_make(("tubes", instance.mesh), partial(_inputs, mesh), partial(round_tubes, mesh))
            meshes.append(made)
        instances[number] = replace(instance, mesh=places[instance.mesh])
    return replace(description, meshes=meshes, instances=instances) if places else description


def _inputs(mesh: Mesh) -> tuple[object, ...]:
    """Returns what the tubes of a mesh depend on."""
    attributes = mesh.uvs, mesh.uvs1, mesh.colors, mesh.tangents
    return mesh.positions, mesh.triangles, mesh.diameters, attributes, mesh.keys, mesh.material


def flat_materials(description: SceneDescription) -> frozenset[int]:
    """Returns the numbers of the materials, other than hair, of curves that are flat and face each ray."""
    if not any(mesh.flat for mesh in description.meshes):
        return frozenset()
    shown = {_material_of(description, each) for each in description.instances if description.meshes[each.mesh].flat}
    return frozenset(k for k in shown if description.materials[k].kind != "hair" and not _emits(description.materials[k]))


def _material_of(description: SceneDescription, instance: Instance) -> int:
    return description.meshes[instance.mesh].material if instance.material is None else instance.material


def _emits(material: Material) -> bool:
    return max(material.emission) > 0 or material.emission_texture is not None
