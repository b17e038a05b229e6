"""Reads scattering inside glTF surfaces and hair: two Khronos drafts, and Rayfarm's own extensions in files from Blender.

The drafts KHR_materials_volume_scatter and KHR_materials_scatter split the attenuation of KHR_materials_volume into scattering
and absorption. A material that also has diffuse transmission has a dense interior, which is rendered as subsurface scattering,
as KHR_materials_volume_scatter recommends.
Source: KhronosGroup/glTF, pull requests 2453 and 2579, their READMEs as of June 2026.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import Vec3
from renderer.scene.material import HAIR_IOR, MOST_DENSE, MOST_FORWARD, Material
from renderer.scene.readers.fibres import elliptic_fibre, fibre
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.textures import Textures
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.readers.scattering import single_albedo
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["NAMES", "read_scatter"]

_VOLUME_SCATTER, _SCATTER = "KHR_materials_volume_scatter", "KHR_materials_scatter"
# Ours, written by renderer/blender and blender/: sigmaA, sigmaS and g of the interior, isInterface for index-matched boundaries;
# subsurfaceFactor, subsurfaceRadius and subsurfaceAnisotropy; betaM, betaN, tilt (radians) and ior of hair of the base colour,
# and alpha, aspectRatio, r, tt and trt if its model is huang.
_MEDIUM, _SUBSURFACE = "RAYFARM_materials_medium", "RAYFARM_materials_subsurface"
_HAIR = "RAYFARM_materials_hair"
NAMES = {_VOLUME_SCATTER, _SCATTER, _MEDIUM, _SUBSURFACE, _HAIR}
_HAIR_DEFAULTS = {"betaM": 0.3, "betaN": 0.3, "tilt": math.radians(2), "ior": HAIR_IOR}  # arguments of `fibre`
_ELLIPTIC_DEFAULTS = {"alpha": 0.3, "aspectRatio": 0.85, "r": 1.0, "tt": 1.0, "trt": 1.0}  # of `elliptic_fibre`
_NONE: Vec3 = (0.0, 0.0, 0.0)


def read_scatter(source: Json, material: Material, textures: Textures, shelf: TextureShelf, is_thin: bool) -> None:
    """Sets a material's interior scattering. Must be called after all other extensions are read.

    is_thin: True if KHR_materials_volume sets no thickness.
    """
    old, new = source.extension(_VOLUME_SCATTER), source.extension(_SCATTER)
    if old:
        color = unit_color(old.vector("multiscatterColor", _NONE))
        _fill(material, color, _g(old, "scatterAnisotropy"))
    elif new:
        strength = unit(new.number("scatterStrengthFactor", 0.0))
        color = unit_color(new.vector("multiscatterColorFactor", (1.0, 1.0, 1.0)))
        picture = textures.find(new, "multiscatterColorTexture", material.name, srgb=True)
        if new.object("scatterStrengthTexture") is not None:
            shelf.warn_of_surface(
                Sentence(
                    "gltf-scatter-texture-dropped",
                    "Material {name}: the texture of the scattering strength is left out.",
                    name=material.name,
                )
            )
        if is_thin:
            _scatter_in_a_sheet(material, strength, color, picture, clamped(new.number("scatterAnisotropy", 0.0), -1.0, 1.0))
        else:
            if picture is not None:
                shelf.warn_of_surface(
                    Sentence(
                        "gltf-scatter-texture-averaged",
                        "Material {name}: the scattering colour is the mean of its texture.",
                        name=material.name,
                    )
                )
                color = unit_color(_mean_color(shelf, picture) * np.array(color))
            _fill(material, unit_color(strength * c for c in color), _g(new, "scatterAnisotropy"))
    _read_ours(source, material)


def _fill(material: Material, multiple: Vec3, g: float) -> None:
    """Splits the volume's attenuation into scattering and absorption.

    multiple: RGB albedo for multiple scattering; g: mean cosine of the scattering angle.
    """
    if math.isinf(material.attenuation_distance) or not any(multiple):
        return
    extinct = [-math.log(clamped(c, 1e-6, 1.0)) / material.attenuation_distance for c in material.attenuation_color]
    if material.diffuse_transmission > 0:
        share = material.diffuse_transmission
        tint = material.diffuse_transmission_color
        seen = (c * t for c, t in zip(multiple, tint, strict=True))
        mixed = ((1 - share) * b + share * c for b, c in zip(material.base_color, seen, strict=True))
        material.base_color = unit_color(mixed)
        material.subsurface = share
        material.subsurface_radius = unit_color((1 / max(t, 1 / MOST_DENSE) for t in extinct), MOST_DENSE)
        material.subsurface_anisotropy = g
        material.diffuse_transmission, material.diffuse_transmission_texture = 0.0, None
    else:
        albedo = [single_albedo(m, g) for m in multiple]
        material.sigma_s = unit_color((t * a for t, a in zip(extinct, albedo, strict=True)), MOST_DENSE)
        material.sigma_a = unit_color((t * (1 - a) for t, a in zip(extinct, albedo, strict=True)), MOST_DENSE)
        material.g = g
    material.attenuation_color, material.attenuation_distance = (1.0, 1.0, 1.0), math.inf


def _scatter_in_a_sheet(material: Material, strength: float, color: Vec3, picture: int | None, g: float) -> None:
    """Sets a thin sheet's diffuse transmission, so that the fraction `strength` of the transmitted light is scattered.

    Of the scattered light, the fraction (1 + g) / 2 leaves on the far side, the rest on the near side. g: mean cosine of the
    scattering angle; color, picture: of the scattered light, the texture as index or None.
    """
    through = material.transmission * strength
    if through <= 0:
        return
    clear = material.transmission * (1 - strength)
    matt = (1 - material.transmission) * np.array(material.base_color) + through * (1 - g) / 2 * np.array(color)
    onwards = through * (1 + g) / 2 / (1 - clear) if clear < 1 else 0.0
    material.transmission, material.transmission_texture = clear, None
    material.diffuse_transmission = unit(onwards)
    material.diffuse_transmission_color, material.diffuse_transmission_color_texture = color, picture
    if onwards < 1 and clear == 0:
        material.base_color = unit_color(matt / (1 - onwards))


def _read_ours(source: Json, material: Material) -> None:
    medium, beneath = source.extension(_MEDIUM), source.extension(_SUBSURFACE)
    if medium:
        material.sigma_a, material.sigma_s = (unit_color(medium.vector(name, _NONE), MOST_DENSE) for name in ("sigmaA", "sigmaS"))
        material.g = _g(medium, "g")
        # The medium includes all absorption; the attenuation that Blender's exporter derives would apply it twice.
        material.attenuation_color, material.attenuation_distance = (1.0, 1.0, 1.0), math.inf
        if medium.value.get("isInterface") is True:
            material.kind = "interface"
    if beneath:
        material.subsurface = unit(beneath.number("subsurfaceFactor", 0.0))
        material.subsurface_radius = unit_color(beneath.vector("subsurfaceRadius", (1.0, 1.0, 1.0)), MOST_DENSE)
        material.subsurface_anisotropy = _g(beneath, "subsurfaceAnisotropy")
    if hair := source.extension(_HAIR):
        said = fibre(*(hair.number(name, value) for name, value in _HAIR_DEFAULTS.items()))
        material.kind, material.ior = "hair", said.ior
        if hair.value.get("model") == "huang":
            said = elliptic_fibre(said, *(hair.number(name, value) for name, value in _ELLIPTIC_DEFAULTS.items()))
            material.model, material.roughness, material.aspect_ratio = said.model, said.roughness, said.aspect_ratio
            material.r, material.tt, material.trt = said.r, said.tt, said.trt
        material.beta_m, material.beta_n, material.tilt = said.beta_m, said.beta_n, said.tilt


def _g(source: Json, name: str) -> float:
    return clamped(source.number(name, 0.0), -MOST_FORWARD, MOST_FORWARD)


def _mean_color(shelf: TextureShelf, texture: int) -> np.ndarray:
    return np.asarray(linear(shelf.image_of(texture)).reshape(-1, 3).mean(axis=0))
