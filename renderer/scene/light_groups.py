"""Light groups of a scene: numbers their names, tabulates the group of each light, and assigns planes of the film to them."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.rows import PART_MATERIAL
from renderer.arrays.scene import CompiledScene
from renderer.scene.description import I32, SceneDescription
from renderer.setting_declaration import MAX_NAME, is_name
from renderer.settings import MAX_LIGHT_GROUPS, REST_GROUP

__all__ = ["LightGroups", "by_light", "names_of", "tabulate_groups", "with_group_planes"]

ENVIRONMENT_GROUP = "environment"  # of a scene that names no group


class LightGroups(NamedTuple):
    """The arrays of CompiledScene that have the light groups."""

    light: I32
    material: I32
    environment: I32
    name: npt.NDArray[np.uint8]


def tabulate_groups(description: SceneDescription, primitive: I32, triangle: I32, part: I32, sphere_material: I32) -> LightGroups:
    """Returns the light groups of a scene's lights, unlit materials and environment.

    primitive: the primitive of each light. triangle, part, sphere_material: as in CompiledScene. A light with a surface is in the
    group of its material. A scene that names no group has one for each of its lamps, as `_by_lamp` names them. Without lamps
    there are no rows.
    """
    of_materials, of_lights = [m.light_group for m in description.materials], [light.light_group for light in description.lights]
    of_environment = description.environment_group
    if not any((*of_materials, *of_lights, of_environment)):
        surfaces = np.arange(1, len(of_materials) + 1, dtype=np.int32), np.zeros(len(of_lights), np.int32)
        shining = set(by_light(*surfaces, primitive, triangle, part, sphere_material).tolist())
        of_materials, of_lights, of_environment = _by_lamp(description, shining)
    names = sorted({*of_materials, *of_lights, of_environment} - {""})
    if not names:
        none = np.zeros(0, np.int32)
        return LightGroups(none, none, np.zeros(1, np.int32), np.zeros(0, np.uint8))
    number = {name: k for k, name in enumerate(["", *names])}
    material = np.array([number[name] for name in of_materials], np.int32)
    punctual = np.array([number[name] for name in of_lights], np.int32)
    light = by_light(material, punctual, primitive, triangle, part, sphere_material)
    text = "\0".join(names).encode()
    text += b"\0" * (-len(text) % np.dtype(np.float32).itemsize)  # the next array of a stored scene is of float32
    environment = np.array([number[of_environment]], np.int32)
    return LightGroups(light, material, environment, np.frombuffer(text, np.uint8))


def _by_lamp(description: SceneDescription, shining: set[int]) -> tuple[list[str], list[str], str]:
    """Returns the groups of a scene's materials, its lights without a surface, and its environment, if each lamp is a group.

    shining: the numbers, from 1 on, of the materials of lights. Lamps of one name are one group. The first MAX_LIGHT_GROUPS - 1
    names get a group each. The environment, also one that replaces the file's, is ENVIRONMENT_GROUP.
    Without lamps, all names are empty.
    """
    lamps = [m.name for k, m in enumerate(description.materials, 1) if k in shining] + [
        light.name for light in description.lights
    ]
    kept = list(dict.fromkeys(_group_name(name) for name in lamps))[: MAX_LIGHT_GROUPS - 1]
    if not kept:
        return [""] * len(description.materials), [""] * len(description.lights), ""

    def group(name: str) -> str:
        found = _group_name(name)
        return found if found in kept else ""

    of_materials = [group(m.name) if k in shining else "" for k, m in enumerate(description.materials, 1)]
    return of_materials, [group(light.name) for light in description.lights], ENVIRONMENT_GROUP


def _group_name(name: str) -> str:
    """Returns the name of a lamp in the form of a group's name, such as "Lamp_001" for "Lamp.001"."""
    text = re.sub(r"[^\w -]", "_", name)[:MAX_NAME].strip()
    return "lamp" if not is_name(text) or text in (REST_GROUP, ENVIRONMENT_GROUP) else text


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
    text = scene.group_name.tobytes().rstrip(b"\0").decode()
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
