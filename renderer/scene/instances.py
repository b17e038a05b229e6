"""Which meshes are kept once and shown many times, and which are copied into the world.

A copy in the world is traced faster (its boxes are tight, no ray is transformed), one that is kept once costs nothing:
so few copies of small meshes are made, and many or large ones are not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Instance, SceneDescription
from renderer.scene.objects import number_objects

__all__ = ["Group", "Sharing", "share"]

_FEW = 8  # triangles that are not worth a tree of their own
_WORTH = 30_000  # triangles that copying would add: then a mesh is kept once
_LARGE = 2_000_000  # triangles of all copies together, from which on everything is kept once
_CONDITION = 1e6  # transforms that squeeze more than this leave too few digits to the rays


class Group(NamedTuple):
    """Meshes that always stand together, and so are one tree, and where they stand."""

    meshes: list[int]
    instances: list[int]  # of the first of the meshes; the others' differ from them in the mesh alone


class Sharing(NamedTuple):
    """How a scene's instances are kept."""

    copied: list[int]  # the instances to place in the world one by one
    groups: list[Group]


def share(description: SceneDescription) -> Sharing:
    """Decides for every instance. What emits light is always copied, for light sampling thinks in the world's space."""
    objects = number_objects(description).instance
    shine = [any(c > 0 for c in material.emission) for material in description.materials]
    sane = _are_invertible(description.instances)
    placed: dict[int, list[int]] = {}  # a mesh's instances that may be kept once
    for number, instance in enumerate(description.instances):
        material = description.meshes[instance.mesh].material if instance.material is None else instance.material
        if sane[number] and not shine[material]:
            placed.setdefault(instance.mesh, []).append(number)
    together: dict[tuple[object, ...], list[int]] = {}
    for mesh, numbers in placed.items():
        if len(numbers) > 1:
            key = tuple(
                (np.asarray(i.transform, np.float64).tobytes(), objects[n], i.material)
                for n in numbers
                for i in (description.instances[n],)
            )
            together.setdefault(key, []).append(mesh)
    shown = sum(len(description.meshes[i.mesh].triangles) for i in description.instances)
    worth = 0 if shown > _LARGE else _WORTH
    groups = []
    kept: set[int] = set()
    for meshes in together.values():
        numbers = placed[meshes[0]]
        triangles = sum(len(description.meshes[m].triangles) for m in meshes)
        if triangles > _FEW and triangles * (len(numbers) - 1) > worth:
            groups.append(Group(meshes, numbers))
            for mesh in meshes:
                kept.update(placed[mesh])
    return Sharing([n for n in range(len(description.instances)) if n not in kept], groups)


def _are_invertible(instances: list[Instance]) -> npt.NDArray[np.bool_]:
    """(I,) whether rays can be carried into an instance's space."""
    matrices = np.array([np.asarray(i.transform, np.float64)[:3, :3] for i in instances]).reshape(-1, 3, 3)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    singular = np.linalg.svd(np.where(finite[:, None, None], matrices, 0.0), compute_uv=False)
    return finite & (singular[:, 2] > 0) & (singular[:, 0] < _CONDITION * singular[:, 2])
