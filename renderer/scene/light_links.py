"""Light links of a scene: numbers its link sets, and tabulates the set of each light and the sets of each object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import I32, LightLink, SceneDescription
from renderer.scene.light_groups import by_light
from renderer.scene.object_ids import number_objects
from renderer.sentences import Sentence

__all__ = ["MAX_LINK_SETS", "LightLinks", "is_included", "names_of_sets", "tabulate_links"]

MAX_LINK_SETS = 31  # an object's sets are bits of an integer; bit 0 is that of lights without a set
_EVERYTHING = 1


class LightLinks(NamedTuple):
    """The arrays of CompiledScene that have the light links; without rows if every light illuminates everything."""

    light: I32
    object: I32


def tabulate_links(description: SceneDescription, primitive: I32, triangle: I32, part: I32, sphere_material: I32) -> LightLinks:
    """Returns the light links of a scene.

    primitive: the primitive of each light. triangle, part, sphere_material: as in CompiledScene. A light with a surface has the
    link set of its material. Raises SceneError if a set or an object is not there, or if there are more than MAX_LINK_SETS sets.
    """
    of_materials, of_lights = [m.light_link for m in description.materials], [light.light_link for light in description.lights]
    names = names_of_sets(description, {*of_materials, *of_lights})
    if not names:
        return LightLinks(np.zeros(0, np.int32), np.zeros(0, np.int32))
    number = {name: k for k, name in enumerate(["", *names])}
    material = np.array([number[name] for name in of_materials], np.int32)
    punctual = np.array([number[name] for name in of_lights], np.int32)
    light = by_light(material, punctual, primitive, triangle, part, sphere_material)
    objects = number_objects(description).names
    links = np.full(len(objects), _EVERYTHING, np.uint32)
    for name in names:
        links |= is_included(name, description.light_links[name], objects).astype(np.uint32) << np.uint32(number[name])
    return LightLinks(light, links.view(np.int32))


def names_of_sets(description: SceneDescription, used: set[str]) -> list[str]:
    """Returns the names in `used`, without the empty one, in alphabetical order.

    Raises SceneError if there is no link set of such a name, or if there are more than MAX_LINK_SETS.
    """
    names = sorted(used - {""})
    for name in names:
        if name not in description.light_links:
            raise SceneError(
                Sentence(
                    "light-link-unknown",
                    "there is no link set {name} in light_links; it has {known}",
                    name=name,
                    known=[*description.light_links][:20],
                )
            )
    if len(names) > MAX_LINK_SETS:
        raise SceneError(
            Sentence(
                "light-links-too-many",
                "lights use {count} link sets of light_links; at most {most} are possible",
                count=len(names),
                most=MAX_LINK_SETS,
            )
        )
    return names


def is_included(name: str, link: LightLink, objects: list[str]) -> np.ndarray:
    """Returns which objects belong to a link set, (o,) bool. name: of the set."""
    included = np.ones(len(objects), bool)
    if link.include is not None:
        included = _is_named(name, link.include, objects)
    return included & ~_is_named(name, link.exclude, objects)


def _is_named(name: str, wanted: tuple[str, ...], objects: list[str]) -> np.ndarray:
    """Returns which objects have one of the names `wanted`, or are parts or copies of such an object, (o,) bool.

    Raises SceneError if a name is that of no object. name: of the link set.
    """
    found = np.zeros(len(objects), bool)
    for each in wanted:
        has_name = np.array([o == each or o.startswith((f"{each}/", f"{each} [")) for o in objects], bool)
        if not has_name.any():
            raise SceneError(
                Sentence(
                    "light-link-object-unknown",
                    "the link set {name} of light_links names {object}, but there is no such object; there are {known}",
                    name=name,
                    object=each,
                    known=objects[:20],
                )
            )
        found |= has_name
    return found
