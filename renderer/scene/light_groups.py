"""Light groups of a scene: numbers their names, tabulates the group of each light, and assigns planes of the film to them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.rows import PART_MATERIAL
from renderer.arrays.scene import CompiledScene
from renderer.scene.description import I32, SceneDescription

__all__ = ["LightGroups", "by_light", "names_of", "tabulate_groups", "with_group_planes"]


class LightGroups(NamedTuple):
    """The arrays of CompiledScene that have the light groups."""

    light: I32
    material: I32
    environment: I32
    name: npt.NDArray[np.uint8]


def tabulate_groups(description: SceneDescription, primitive: I32, triangle: I32, part: I32, sphere_material: I32) -> LightGroups:
    """Returns the light groups of a scene's lights, unlit materials and environment.

    primitive: the primitive of each light. triangle, part, sphere_material: as in CompiledScene. A light with a surface is in the
    group of its material. Without any name there are no rows.
    """
    of_materials, of_lights = [m.light_group for m in description.materials], [light.light_group for light in description.lights]
    names = sorted({*of_materials, *of_lights, description.environment_group} - {""})
    if not names:
        none = np.zeros(0, np.int32)
        return LightGroups(none, none, np.zeros(1, np.int32), np.zeros(0, np.uint8))
    number = {name: k for k, name in enumerate(["", *names])}
    material = np.array([number[name] for name in of_materials], np.int32)
    punctual = np.array([number[name] for name in of_lights], np.int32)
    light = by_light(material, punctual, primitive, triangle, part, sphere_material)
    text = np.frombuffer("\0".join(names).encode(), np.uint8)
    return LightGroups(light, material, np.array([number[description.environment_group]], np.int32), text)


def by_light(material: I32, punctual: I32, primitive: I32, triangle: I32, part: I32, sphere_material: I32) -> I32:
    """Returns a number for each light, (L,): that of its material if it has a surface, else its own.

    material: a number for each material. punctual: a number for each light without a surface. primitive: the primitive of each
    light. triangle, part, sphere_material: as in CompiledScene.
    """
    on_sphere, alone = len(triangle), len(triangle) + len(sphere_material)
    light = np.zeros(len(primitive), np.int32)
    of_triangles, of_spheres = primitive < on_sphere, (primitive >= on_sphere) & (primitive < alone)
    light[of_triangles] = material[part[triangle[primitive[of_triangles], 3], PART_MATERIAL]]
    light[of_spheres] = material[sphere_material[primitive[of_spheres] - on_sphere]]
    light[primitive >= alone] = punctual[primitive[primitive >= alone] - alone]
    return light


def names_of(scene: CompiledScene) -> list[str]:
    """Returns the names of a scene's light groups in alphabetical order; group k is the k-th, from 1 on."""
    text = scene.group_name.tobytes().decode()
    return text.split("\0") if text else []


def with_group_planes(scene: CompiledScene, names: tuple[str, ...]) -> CompiledScene:
    """Returns the scene with the planes of the film for each of its light groups.

    names: RenderSettings.group_names: groups of other names, and lights without a group, get the last one's planes. Empty: the
    scene is returned as it is.
    """
    if not names:
        return scene
    plane = np.array([names.index(name) if name in names else len(names) - 1 for name in ["", *names_of(scene)]], np.int32)
    light, material = scene.light_group, scene.material_group
    if len(light) == 0:  # a kernel looks up the group of light 0 where there is none
        light = np.zeros(max(len(scene.light_primitive), 1), np.int32)
    if len(material) == 0:
        material = np.zeros(max(len(scene.material_kind), 1), np.int32)
    for array in (plane, light, material):
        array.flags.writeable = False
    return scene._replace(group_plane=plane, light_group=light, material_group=material)
