"""Decides which meshes are stored once and instanced, and which are copied into world space.

A copy in world space is traced faster (its boxes are tight, and rays need no transform); an instance costs no memory. So small
meshes with few instances are copied; large meshes and those with many instances are not. Moving meshes are always stored once,
in their own space, so that another frame changes their transform only; deforming or emitting ones are placed in world space for
each frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.transforms import scale_range
from renderer.scene.description import Instance, Material, SceneDescription
from renderer.scene.object_ids import number_objects

__all__ = [
    "Group",
    "Sharing",
    "StaticSharing",
    "is_linearly_keyed",
    "is_placed_per_frame",
    "plan_instancing",
    "plan_moving_instances",
    "plan_static_instancing",
]

_MIN_TREE_TRIANGLES = 8  # triangles: fewer are not worth a separate tree
_MIN_SAVED_TRIANGLES = 30_000  # a mesh is stored once if its copies would add at least this many triangles
_LARGE = 2_000_000  # every repeated mesh is stored once if all copies have at least this many triangles
_CONDITION = 1e6  # transforms of a higher condition number are too imprecise for rays


class Group(NamedTuple):
    """Meshes that are always placed together and so share one BVH, and the indices of the instances that place them."""

    meshes: list[int]
    instances: list[int]  # of the first mesh; those of the others are equal except for their mesh


class Sharing(NamedTuple):
    """The decision how each instance of a scene is stored: copied into world space, instanced, or placed again for each frame.

    `copied` and `groups` are the same for all frames of a shot.
    """

    copied: list[int]  # the instances to place in world space one by one
    groups: list[Group]
    bodies: list[Group]  # moving rigid bodies
    loose: list[int]  # moving geometry placed in world space for each frame


class StaticSharing(NamedTuple):
    """The decision how each static instance is stored (copied or instanced), and the indices of the moving instances."""

    copied: list[int]
    groups: list[Group]
    movers: list[int]


def plan_instancing(description: SceneDescription) -> Sharing:
    """Decides for each instance whether it is copied, instanced or placed per frame.

    Emitting instances are never instanced, since light sampling works in world space.
    """
    standing = plan_static_instancing(description)
    return Sharing(standing.copied, standing.groups, *plan_moving_instances(description, standing.movers))


def plan_static_instancing(description: SceneDescription) -> StaticSharing:
    """Decides how static instances are stored, independently of the moving ones."""
    instances, meshes = description.instances, description.meshes
    movers = [n for n, instance in enumerate(instances) if instance.moves or meshes[instance.mesh].deforms]
    moving = set(movers)
    still = [n for n in range(len(instances)) if n not in moving]
    sane = _are_invertible([instances[n] for n in still])
    fit = [n for n, is_sane in zip(still, sane, strict=True) if is_sane and not _is_placed_per_frame(description, n)]
    groups = _group_repeated_meshes(description, number_objects(description).instance, still, fit)
    kept = {m for group in groups for m in group.meshes}
    once = {n for n in fit if instances[n].mesh in kept}
    return StaticSharing([n for n in still if n not in once], groups, movers)


def plan_moving_instances(description: SceneDescription, movers: list[int]) -> tuple[list[Group], list[int]]:
    """Divides the moving instances into rigid bodies and those that are placed in world space for each frame.

    movers: indices of the moving instances. Returns the bodies, and the indices of the others.
    """
    instances = description.instances
    sane = _are_invertible([instances[n] for n in movers])
    bodily = [
        n
        for n, is_sane in zip(movers, sane, strict=True)
        if is_sane and not description.meshes[instances[n].mesh].deforms and not _is_placed_per_frame(description, n)
    ]
    bodies = set(bodily)
    return _group_bodies(description, bodily), [n for n in movers if n not in bodies]


def is_linearly_keyed(description: SceneDescription, instance: Instance) -> bool:
    """Returns True if the instance moves while the shutter is open and its vertices are interpolated linearly between keys.

    That is the case for deforming and for emitting geometry.
    """
    mesh = description.meshes[instance.mesh]
    material = description.materials[mesh.material if instance.material is None else instance.material]
    return bool(instance.keys) and (mesh.deforms or bool(mesh.keys) or is_placed_per_frame(material))


def is_placed_per_frame(material: Material) -> bool:
    """Returns True if moving instances of the material are placed in world space for each frame.

    True for emitters, and for materials that some kinds of rays ignore.
    """
    return max(material.emission) > 0 or material.lamp or material.unseen or material.shadeless or bool(material.hidden_from)


def _is_placed_per_frame(description: SceneDescription, number: int) -> bool:
    instance = description.instances[number]
    material = description.meshes[instance.mesh].material if instance.material is None else instance.material
    return is_placed_per_frame(description.materials[material])


def _group_repeated_meshes(description: SceneDescription, objects: list[int], still: list[int], fit: list[int]) -> list[Group]:
    """Returns the groups of meshes whose static instances share one stored copy.

    Meshes are grouped only if that saves enough triangles compared with copying each instance.
    """
    placed: dict[int, list[int]] = {}
    for number in fit:
        placed.setdefault(description.instances[number].mesh, []).append(number)
    together: dict[tuple[object, ...], list[int]] = {}
    for mesh, numbers in placed.items():
        if len(numbers) > 1:
            key = tuple(
                (np.asarray(i.transform, np.float64).tobytes(), objects[n], i.material)
                for n in numbers
                for i in (description.instances[n],)
            )
            together.setdefault(key, []).append(mesh)
    shown = sum(len(description.meshes[description.instances[n].mesh].triangles) for n in still)
    worth = 0 if shown > _LARGE else _MIN_SAVED_TRIANGLES
    groups = []
    for meshes in together.values():
        numbers = placed[meshes[0]]
        triangles = sum(len(description.meshes[m].triangles) for m in meshes)
        if triangles > _MIN_TREE_TRIANGLES and triangles * (len(numbers) - 1) > worth:
            groups.append(Group(meshes, numbers))
    return groups


def _group_bodies(description: SceneDescription, movers: list[int]) -> list[Group]:
    """Groups moving instances of the same name and transform into rigid bodies: the primitives of a glTF node, for example."""
    parts: dict[tuple[object, ...], list[int]] = {}
    for number in movers:
        instance = description.instances[number]
        place = np.asarray(instance.transform, np.float64).tobytes()
        way = b"".join(np.asarray(key, np.float64).tobytes() for key in instance.keys)
        parts.setdefault((instance.name or number, place, way, instance.material), []).append(number)
    bodies: dict[tuple[int, ...], list[int]] = {}
    for numbers in parts.values():
        bodies.setdefault(tuple(description.instances[n].mesh for n in numbers), []).append(numbers[0])
    return [Group(list(meshes), numbers) for meshes, numbers in bodies.items()]


def _are_invertible(instances: list[Instance]) -> npt.NDArray[np.bool_]:
    """Returns a mask (I,): whether each instance's transform is conditioned well enough to transform rays into its space."""
    places = [each for i in instances for each in (i.transform, *i.keys)]
    most, least = scale_range(np.array([np.asarray(place, np.float64)[:3] for place in places]).reshape(-1, 3, 4)).T
    first = np.cumsum([0] + [1 + len(i.keys) for i in instances])[:-1]
    sane = (least > 0) & (most < _CONDITION * least)
    return np.logical_and.reduceat(sane, first) if len(instances) else sane
