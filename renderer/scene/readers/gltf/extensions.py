"""Reads material parameters: those of the table in renderer/scene/material.py, and the extensions that need code of their own.

Source: KhronosGroup/glTF, extensions/2.0/Khronos, the README of each extension.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from renderer.scene.material import ALL_REFLECTING_IOR, PARAMETERS, Material
from renderer.scene.parameters import Parameter
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.textures import Textures
from renderer.scene.readers.number_ranges import clamped

__all__ = ["METALLIC_ROUGHNESS", "NAMES", "has_thickness", "read_extensions", "read_parameters"]

METALLIC_ROUGHNESS = "pbrMetallicRoughness"

_ONE_EACH = ("color", "radiance", "triple")


def read_parameters(source: Json, material: Material, textures: Textures, metallic_roughness: bool) -> None:
    """Sets the material's parameters that the table maps to glTF; absent ones retain their values.

    metallic_roughness: whether to read the parameters in pbrMetallicRoughness.
    """
    for parameter in PARAMETERS:
        *way, key = (parameter.gltf or "").split(".")
        if not key or (way[:1] == [METALLIC_ROUGHNESS] and not metallic_roughness):
            continue
        owner = _owner(source, way)
        if owner is not None and key in owner:
            setattr(material, parameter.name, _value(parameter, owner, key, material, textures))


def read_extensions(source: Json, material: Material) -> None:
    """Sets the parameters whose values need conversion. Must be called after `read_parameters`."""
    for name, read in _READERS.items():
        found = source.extension(name)
        if found:
            read(found, material)


def has_thickness(material: Json) -> bool:
    """Returns True if KHR_materials_volume makes the surface the boundary of a volume."""
    volume = material.extension("KHR_materials_volume")
    return volume is not None and volume.number("thicknessFactor", 0.0) > 0


def _owner(source: Json, path: list[str]) -> Json | None:
    owner: Json | None = source
    for step in path:
        if owner is not None:
            owner = owner.extension(step) if step.startswith(_EXTENSION) else owner.object(step)
    return owner


def _value(parameter: Parameter, owner: Json, key: str, material: Material, textures: Textures) -> object:
    if parameter.form == "texture":
        return textures.find(owner, key, material.name, srgb=parameter.srgb)
    if parameter.form == "flag":
        return owner.value[key] is True
    if parameter.form in _ONE_EACH:
        values = owner.vector(key, getattr(material, parameter.name))
        return tuple(owner.clamped(key, value, parameter.low, parameter.high) for value in values)
    return owner.clamped(key, owner.number(key, getattr(material, parameter.name)), parameter.low, parameter.high)


def _ior(source: Json, material: Material) -> None:
    ior = source.number("ior", 1.5)
    # 0 means total reflection
    material.ior = source.clamped("ior", ior, 1.0, ALL_REFLECTING_IOR) if ior > 0 else ALL_REFLECTING_IOR


def _volume(source: Json, material: Material) -> None:
    # The thickness and its texture are approximations for rasterisers; a path tracer intersects the far side.
    distance = source.number("attenuationDistance", 0.0)
    material.attenuation_distance = distance if distance > 0 else math.inf


def _iridescence(source: Json, material: Material) -> None:
    thinnest, thickest = material.iridescence_thickness
    thinnest = clamped(source.number("iridescenceThicknessMinimum", thinnest), 0.0, 1e5)
    material.iridescence_thickness = (thinnest, clamped(source.number("iridescenceThicknessMaximum", thickest), 0.0, 1e5))


def _unlit(source: Json, material: Material) -> None:
    material.kind = "unlit"
    material.emission, material.emission_texture, material.normal_texture = (0.0, 0.0, 0.0), None, None


_EXTENSION = ("KHR_", "RAYFARM_")
_READERS: dict[str, Callable[[Json, Material], None]] = {
    "KHR_materials_ior": _ior,
    "KHR_materials_volume": _volume,
    "KHR_materials_iridescence": _iridescence,
    "KHR_materials_unlit": _unlit,
}
# The supported material extensions.
NAMES = {*_READERS, *(p.gltf.split(".")[0] for p in PARAMETERS if p.gltf and p.gltf.startswith(_EXTENSION))}
