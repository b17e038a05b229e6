"""Known differences between Rayfarm's picture and Mitsuba's or pbrt's, depending on the content of the scene.

The numbers are from docs/correctness.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from renderer.kernel.bsdf.albedo_tables import SIZE, table_path
from renderer.scene.description import SceneDescription
from renderer.scene.material import Material

__all__ = ["known_differences"]

_MIN_DIFFERENCE = 0.005  # smallest relative difference reported
_SLOPES, _DARKER = (0.0, 0.25, 0.5, 1.0), (0.0, 0.024, 0.089, 0.285)  # slopes of bumps, and the loss by Mitsuba's shadowing term


def known_differences(scene: SceneDescription, other: str) -> list[str]:
    """Returns the known differences as sentences. other: name of the other renderer."""
    found = []
    if metals := _lost_energy(scene, _is_metal):
        found.append(
            f"Rough metal ({_format_list(metals)}): light that meets a second facet is lost in {other} and kept here, as by a "
            f"random walk over facets; a white metal as rough is up to {_percent(max(metals.values()))} brighter here"
        )
    if glasses := _lost_energy(scene, _is_glass):
        found.append(
            f"Rough glass ({_format_list(glasses)}): the same; some percent brighter here, most where it is seen at an angle"
        )
    if bumps := _normal_map_darkening(scene) if any("shadowing function" in words for words in scene.warnings) else {}:
        found.append(
            f"Normal maps ({_format_list(bumps)}): Mitsuba darkens them by its shadowing function; a "
            f"matt surface of such slopes is up to {_percent(max(bumps.values()))} brighter here"
        )
    return found


def _lost_energy(scene: SceneDescription, is_meant: Callable[[Material], bool]) -> dict[str, float]:
    """Returns the energy that single scattering on microfacets loses, by material name, relative to the remaining energy."""
    return {
        material.name: lost
        for material in _used_materials(scene)
        if is_meant(material) and (lost := 1 / _mean_albedo(material.roughness or 0.0) - 1) > _MIN_DIFFERENCE
    }


def _used_materials(scene: SceneDescription) -> list[Material]:
    numbers = {scene.meshes[each.mesh].material if each.material is None else each.material for each in scene.instances}
    numbers |= {each.material for each in scene.spheres}
    return [scene.materials[number] for number in sorted(numbers)]


def _is_metal(material: Material) -> bool:
    return material.kind == "conductor" or (material.kind == "metallic_roughness" and material.metallic > 0.5)


def _is_glass(material: Material) -> bool:
    is_clear = material.kind == "glass" or (material.kind == "metallic_roughness" and material.transmission > 0.5)
    return is_clear and not material.thin


def _mean_albedo(roughness: float) -> float:
    """Returns the single-scattering albedo of a white metal, averaged over the hemisphere. Rayfarm compensates the loss."""
    means = np.load(table_path("ggx_albedo"))[SIZE].sum(axis=-1)
    return float(np.interp(roughness, np.linspace(0.0, 1.0, SIZE), means))


def _normal_map_darkening(scene: SceneDescription) -> dict[str, float]:
    """Returns, by name of normal-mapped materials, how much Mitsuba's shadowing term darkens a matt surface, as a fraction.

    Computed from the mean slope of each normal map.
    """
    found = {}
    for material in _used_materials(scene):
        if material.normal_texture is None:
            continue
        pixels = scene.images[scene.textures[material.normal_texture].image].pixels[..., :3].astype(np.float32) / 255 * 2 - 1
        across = np.hypot(pixels[..., 0], pixels[..., 1]) * material.normal_scale / np.maximum(pixels[..., 2], 1e-3)
        slope = min(float(np.sqrt((across**2).mean())), 1.0)
        if (darker := float(np.interp(slope, _SLOPES, _DARKER))) > _MIN_DIFFERENCE:
            found[material.name] = darker
    return found


def _format_list(names: dict[str, float]) -> str:
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(sorted(names, key=lambda name: -names[name])[:4]) + more


def _percent(share: float) -> str:
    return f"{math.ceil(share * 100)} %"
