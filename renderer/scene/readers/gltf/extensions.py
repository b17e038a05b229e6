"""The KHR_materials extensions, each a function that sets its fields of a Material.

Source: KhronosGroup/glTF, extensions/2.0/Khronos, the README of each name.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from renderer.scene.description import Material
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.textures import Textures
from renderer.scene.readers.numbers import clamped, unit, unit_color

__all__ = ["READERS", "has_thickness", "normal_scale"]

Reader = Callable[[Json, Material, Textures], None]

_ALL_REFLECTING_IOR = 1000.0  # KHR_materials_ior means by 0 that normal incidence reflects all; this reflects 0.996
_WHITE = (1.0, 1.0, 1.0)


def has_thickness(material: Json) -> bool:
    """Whether KHR_materials_volume says that the surface bounds a volume."""
    volume = material.extension("KHR_materials_volume")
    return volume is not None and volume.number("thicknessFactor", 0.0) > 0


def normal_scale(owner: Json, key: str) -> float:
    """How strong a normal map is."""
    info = owner.object(key)
    return clamped(info.number("scale", 1.0), -100.0, 100.0) if info else 1.0


def _ior(source: Json, material: Material, textures: Textures) -> None:
    ior = source.number("ior", 1.5)
    material.ior = clamped(ior, 1.0, _ALL_REFLECTING_IOR) if ior > 0 else _ALL_REFLECTING_IOR


def _specular(source: Json, material: Material, textures: Textures) -> None:
    material.specular = unit(source.number("specularFactor", 1.0))
    material.specular_texture = textures.find(source, "specularTexture", material.name)
    material.specular_color = unit_color(source.vector("specularColorFactor", _WHITE), high=1000.0)  # above 1 up to F0 = 1
    material.specular_color_texture = textures.find(source, "specularColorTexture", material.name, srgb=True)


def _clearcoat(source: Json, material: Material, textures: Textures) -> None:
    material.clearcoat = unit(source.number("clearcoatFactor", 0.0))
    material.clearcoat_texture = textures.find(source, "clearcoatTexture", material.name)
    material.clearcoat_roughness = unit(source.number("clearcoatRoughnessFactor", 0.0))
    material.clearcoat_roughness_texture = textures.find(source, "clearcoatRoughnessTexture", material.name)
    material.clearcoat_normal_texture = textures.find(source, "clearcoatNormalTexture", material.name)
    material.clearcoat_normal_scale = normal_scale(source, "clearcoatNormalTexture")


def _sheen(source: Json, material: Material, textures: Textures) -> None:
    material.sheen_color = unit_color(source.vector("sheenColorFactor", (0.0, 0.0, 0.0)))
    material.sheen_color_texture = textures.find(source, "sheenColorTexture", material.name, srgb=True)
    material.sheen_roughness = unit(source.number("sheenRoughnessFactor", 0.0))
    material.sheen_roughness_texture = textures.find(source, "sheenRoughnessTexture", material.name)


def _transmission(source: Json, material: Material, textures: Textures) -> None:
    material.transmission = unit(source.number("transmissionFactor", 0.0))
    material.transmission_texture = textures.find(source, "transmissionTexture", material.name)


def _volume(source: Json, material: Material, textures: Textures) -> None:
    # The thickness, and its texture, let rasterisers guess at what a path tracer meets: how far it is to the other side.
    material.attenuation_color = unit_color(source.vector("attenuationColor", _WHITE))
    distance = source.number("attenuationDistance", 0.0)
    material.attenuation_distance = distance if distance > 0 else math.inf


def _anisotropy(source: Json, material: Material, textures: Textures) -> None:
    material.anisotropy = unit(source.number("anisotropyStrength", 0.0))
    material.anisotropy_rotation = math.remainder(source.number("anisotropyRotation", 0.0), 2 * math.pi)
    material.anisotropy_texture = textures.find(source, "anisotropyTexture", material.name)


def _iridescence(source: Json, material: Material, textures: Textures) -> None:
    material.iridescence = unit(source.number("iridescenceFactor", 0.0))
    material.iridescence_texture = textures.find(source, "iridescenceTexture", material.name)
    material.iridescence_ior = clamped(source.number("iridescenceIor", 1.3), 1.0, 5.0)
    thinnest = clamped(source.number("iridescenceThicknessMinimum", 100.0), 0.0, 1e5)
    thickest = clamped(source.number("iridescenceThicknessMaximum", 400.0), 0.0, 1e5)
    material.iridescence_thickness = (thinnest, thickest)
    material.iridescence_thickness_texture = textures.find(source, "iridescenceThicknessTexture", material.name)


def _dispersion(source: Json, material: Material, textures: Textures) -> None:
    material.dispersion = clamped(source.number("dispersion", 0.0), 0.0, 20.0)


def _diffuse_transmission(source: Json, material: Material, textures: Textures) -> None:
    material.diffuse_transmission = unit(source.number("diffuseTransmissionFactor", 0.0))
    material.diffuse_transmission_texture = textures.find(source, "diffuseTransmissionTexture", material.name)
    material.diffuse_transmission_color = unit_color(source.vector("diffuseTransmissionColorFactor", _WHITE))
    found = textures.find(source, "diffuseTransmissionColorTexture", material.name, srgb=True)
    material.diffuse_transmission_color_texture = found


def _unlit(source: Json, material: Material, textures: Textures) -> None:
    material.kind = "unlit"
    material.emission, material.emission_texture, material.normal_texture = (0.0, 0.0, 0.0), None, None


READERS: dict[str, Reader] = {
    "KHR_materials_ior": _ior,
    "KHR_materials_specular": _specular,
    "KHR_materials_clearcoat": _clearcoat,
    "KHR_materials_sheen": _sheen,
    "KHR_materials_transmission": _transmission,
    "KHR_materials_volume": _volume,
    "KHR_materials_anisotropy": _anisotropy,
    "KHR_materials_iridescence": _iridescence,
    "KHR_materials_dispersion": _dispersion,
    "KHR_materials_diffuse_transmission": _diffuse_transmission,
    "KHR_materials_unlit": _unlit,
}
