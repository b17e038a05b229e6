"""Converts the object and material numbers in the farm's AOVs to Blender's pass indices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .gltf import object_names
from .model import Node, Scene

__all__ = ["Ids", "ids_of"]

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
THROUGH = "KHR_materials_transmission"


@dataclass(frozen=True)
class Ids:
    """Tables from the farm's object and material numbers to Blender's pass indices; 0 for unknown numbers.

    objects, materials: the pass index of each object and of each material. only: for each object that has a single material, the
    pass index of that material, by the object's number.
    """

    objects: F32
    materials: F32
    only: F32

    def object(self, numbers: I64) -> F32:
        """Returns the pass indices of objects, given the farm's object numbers."""
        return _look_up(self.objects, numbers)

    def material(self, numbers: I64, objects: I64) -> F32:
        """Returns the pass indices of materials, given the farm's numbers of materials and of the objects at the same pixels."""
        known = numbers < len(self.materials)
        return np.where(known, _look_up(self.materials, numbers), _look_up(self.only, objects)).astype(np.float32)


def ids_of(scene: Scene) -> Ids:
    """Returns the Ids of a scene.

    The farm numbers objects from 1: meshes, then lamps. It numbers materials in this order: those of lamps; those of the scene;
    copies for objects that some rays ignore, in order of appearance; copies for glass without an interior, whose numbers only the
    farm can determine.
    """
    nodes = object_names(scene)
    numbers = {key: material.number for key, material in scene.materials.items()}
    used = [[node.materials[min(slot, len(node.materials) - 1)] for slot, _ in scene.meshes[node.mesh].parts] for node in nodes]
    materials = [0] * (1 + len(scene.lamp_materials)) + list(numbers.values())
    if not any(THROUGH in material.gltf.get("extensions", {}) for material in scene.materials.values()):
        materials += [numbers[key] for key in _copies(nodes, used)]
    only = [numbers[keys[0]] if len(set(keys)) == 1 else 0 for keys in used]
    told = [0, *(node.number for node in nodes)], materials, [0, *only]
    return Ids(*(np.array(each, np.float32) for each in told))


def _copies(nodes: list[Node], used: list[list[str]]) -> list[str]:
    found = dict.fromkeys(
        (key, node.hidden_from, node.matte)
        for node, keys in zip(nodes, used, strict=True)
        if node.hidden_from or node.matte
        for key in keys
    )
    return [key for key, *_ in found]


def _look_up(table: F32, numbers: I64) -> F32:
    return np.where((numbers >= 0) & (numbers < len(table)), table[np.clip(numbers, 0, len(table) - 1)], 0).astype(np.float32)
