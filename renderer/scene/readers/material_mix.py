"""Represents a mixture of two materials by a single material, where its parameters allow that."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from renderer.scene.description import Material, Vec3
from renderer.scene.readers.coats import dielectric_albedo
from renderer.scene.readers.metals import normal_reflectance

__all__ = ["mix_materials"]

_PAINT = ("name", "kind", "base_color", "base_color_texture", "double_sided")
_GLOSS = (
    "distribution",
    "roughness",
    "metallic",
    "metallic_roughness_texture",
    "ior",
    "anisotropy",
    "anisotropy_rotation",
    "eta",
    "k",
)
_PLAIN = Material()
_HEAD_ON = 0.04  # reflectance at normal incidence for ior 1.5


class _BaseAndGloss(NamedTuple):
    """A material reduced to a diffuse base and a glossy layer over it.

    matt, texture: colour of the base, and the texture that multiplies it. normal_reflectance: reflectance of the glossy layer at
    normal incidence; None without that layer. all_round: hemispherical albedo of the glossy layer.
    """

    matt: np.ndarray
    texture: int | None
    normal_reflectance: np.ndarray | None = None
    all_round: float = 0.0


def mix_materials(first: Material, second: Material, share: float) -> Material | None:
    """Returns the mixture of two materials; None if no single material represents it.

    share: weight of the second material. Supported are mixtures of diffuse, plastic and metal materials in which only one has a
    glossy layer, or both have the same. If one material has opacity 0, the result is the other one, partly transparent.
    """
    if share <= 0 or share >= 1:
        return second if share >= 1 else first
    for one, other, part in ((first, second, share), (second, first, 1 - share)):
        if one.opacity == 0:
            return replace(other, opacity=other.opacity * part, alpha_mode="blend")
    looks = [_lobes_of(each) for each in (first, second)]
    if looks[0] is None or looks[1] is None:
        return None
    parts = [(each, part, made) for each, part, made in zip(looks, (1 - share, share), (first, second), strict=True) if each]
    glossy = [entry for entry in parts if entry[0].normal_reflectance is not None]
    colored = [entry for entry in parts if entry[0].matt.any()]
    if len({each.texture for each, _, _ in colored}) > 1:
        return None
    matt = sum((each.matt * (1 - each.all_round) * part for each, part, _ in parts), start=np.zeros(3))
    texture = colored[0][0].texture if colored else None
    if not glossy:
        return Material(base_color=_vec(matt), base_color_texture=texture)
    if len(glossy) == 2 and not _have_same_gloss(first, second):
        return None
    gloss, _, made = glossy[0]
    weight = sum(part for _, part, _ in glossy)
    assert gloss.normal_reflectance is not None
    kept = {
        name: getattr(made, name) for name in ("distribution", "anisotropy", "anisotropy_rotation", "metallic_roughness_texture")
    }
    return Material(
        kind="metallic_roughness",
        base_color=_vec(np.minimum(matt / (1 - weight * gloss.all_round), 1)),
        base_color_texture=texture,
        specular=weight,
        specular_color=_vec(gloss.normal_reflectance / _HEAD_ON),
        roughness=made.roughness or 0.0,
        **kept,
    )


def _lobes_of(material: Material) -> _BaseAndGloss | None:
    color, texture = np.array(material.base_color), material.base_color_texture
    own = {each.name for each in fields(material) if getattr(material, each.name) != getattr(_PLAIN, each.name)}
    if material.kind == "diffuse" and own <= set(_PAINT):
        return _BaseAndGloss(color, texture)
    if not own <= {*_PAINT, *_GLOSS}:
        return None
    bare = np.zeros(3)
    if material.kind == "conductor":
        reflected = normal_reflectance(material.eta, material.k)
    elif (material.kind == "mirror" or (material.kind == "metallic_roughness" and material.metallic == 1)) and texture is None:
        reflected = color
    elif material.kind == "metallic_roughness" and material.metallic == 0:
        return _BaseAndGloss(
            color, texture, np.full(3, ((material.ior - 1) / (material.ior + 1)) ** 2), dielectric_albedo(material.ior)
        )
    else:
        return None
    return _BaseAndGloss(
        bare, None, np.asarray(reflected), float(reflected.max() + (1 - reflected.max()) / 21)
    )  # hemispherical mean of Schlick's approximation


def _have_same_gloss(first: Material, second: Material) -> bool:
    return all(getattr(first, name) == getattr(second, name) for name in ("kind", *_GLOSS)) and (
        first.metallic == 0 or first.base_color == second.base_color
    )


def _vec(values: np.ndarray) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
