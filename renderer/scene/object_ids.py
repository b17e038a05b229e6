"""Assigns the numbers of the object ID AOV to a scene's instances and spheres, with their names."""

from __future__ import annotations

from typing import NamedTuple

from renderer.scene.description import SceneDescription

__all__ = ["Objects", "moving_poses", "number_objects"]


class Objects(NamedTuple):
    """The numbers of a scene's objects: that of each instance and of each sphere, and each object's name.

    Objects are numbered in order of first appearance, instances before spheres.
    """

    names: list[str]  # of each object
    instance: list[int]  # each instance's object
    sphere: list[int]  # each sphere's


def number_objects(description: SceneDescription) -> Objects:
    """Numbers the objects: all instances of one name are one object.

    Each unnamed instance is an object, named after its mesh, and so is each sphere.
    """
    names: list[str] = []
    known: dict[str, int] = {}
    instances = []
    for instance in description.instances:
        number = known.get(instance.name) if instance.name else None
        if number is None:
            number = len(names)
            names.append(instance.name or description.meshes[instance.mesh].name)
            if instance.name:
                known[instance.name] = number
        instances.append(number)
    spheres = list(range(len(names), len(names) + len(description.spheres)))
    return Objects(names + [s.name for s in description.spheres], instances, spheres)


def moving_poses(description: SceneDescription) -> dict[str, list[list[float]]]:
    """Returns the transforms (4, 4) from mesh to world space of the objects that move, by number as text.

    An object of several instances has that of the first. A sphere's transform is the translation to its centre.
    """
    numbers = number_objects(description)
    found: dict[str, list[list[float]]] = {}
    for instance, number in zip(description.instances, numbers.instance, strict=True):
        if instance.moves:
            found.setdefault(str(number), instance.transform.tolist())
    for sphere, number in zip(description.spheres, numbers.sphere, strict=True):
        if sphere.moves:
            x, y, z = sphere.center
            found[str(number)] = [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]
    return found
