"""Visibility of objects and lights by kind of ray, and shadow links: the objects that alone block a light (tables)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.bvh.layout import RAY_KINDS
from renderer.scene.description import I32, SceneDescription
from renderer.scene.light_groups import by_light
from renderer.scene.light_links import is_included, names_of_sets
from renderer.scene.object_ids import number_objects

__all__ = ["Visibility", "tabulate_visibility"]

_SHADOW = RAY_KINDS.index("shadow")
_EVERY_KIND = (1 << len(RAY_KINDS)) - 1


class Visibility(NamedTuple):
    """The visibility of a scene's lights, and its shadow links.

    is_by_kind: whether anything depends on the kind of ray beyond what camera rays and shadow rays see; otherwise `light` has no
    rows. blocking: for each set of shadow links in use, which objects block, (o,) bool.
    """

    is_by_kind: bool
    light: I32  # `light_visibility` of CompiledScene
    blocking: list[npt.NDArray[np.bool_]]
    lights_differ: bool  # whether some light is visible to one of diffuse and glossy rays only


def tabulate_visibility(
    description: SceneDescription, primitive: I32, triangle: I32, part: I32, sphere_material: I32
) -> Visibility:
    """Returns the Visibility of a scene. primitive, triangle, part, sphere_material: as for `tabulate_links`.

    Raises SceneError if a link set or an object that it names is not there.
    """
    materials, lights = description.materials, description.lights
    names = names_of_sets(description, {m.shadow_link for m in materials} | {light.shadow_link for light in lights})
    if not (names or any(m.hidden_from for m in materials) or any(light.hidden_from for light in lights)):
        return Visibility(False, np.zeros(0, np.int32), [], False)
    root = {name: _SHADOW if k == 0 else len(RAY_KINDS) + k - 1 for k, name in enumerate(["", *names])}

    def word(hidden_from: tuple[str, ...], link: str) -> int:
        hidden = sum(1 << RAY_KINDS.index(kind) for kind in hidden_from)
        return (_EVERY_KIND & ~hidden) | root[link] << rows.LIGHT_ROOT_BIT

    of_materials = np.array([word(m.hidden_from, m.shadow_link) for m in materials], np.int32)
    of_lights = np.array([word(light.hidden_from, light.shadow_link) for light in lights], np.int32)
    words = by_light(of_materials, of_lights, primitive, triangle, part, sphere_material)
    by_diffuse, by_glossy = (words >> RAY_KINDS.index(kind) & 1 for kind in ("diffuse", "glossy"))
    objects = number_objects(description).names
    blocking = [is_included(name, description.light_links[name], objects) for name in names]
    return Visibility(True, words, blocking, bool((by_diffuse != by_glossy).any()))
