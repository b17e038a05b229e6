"""Assigns the numbers of the object ID AOV to a scene's instances and spheres, with their names."""

from __future__ import annotations

from typing import NamedTuple

from renderer.scene.description import SceneDescription

__all__ = ["Objects", "number_objects"]


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
