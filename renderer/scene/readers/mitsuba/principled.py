"""Converts Mitsuba's principled BSDFs (Burley 2012 and 2015) to metallic-roughness materials."""

from __future__ import annotations

import math
from dataclasses import replace

from renderer.scene.description import Material
from renderer.scene.material import ALL_REFLECTING_IOR
from renderer.scene.readers.anisotropy import brushed
from renderer.scene.readers.coats import dielectric_albedo, ior_of
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.textures import Textures
from renderer.scene.readers.number_ranges import clamped, unit
from renderer.sentences import Sentence

__all__ = ["principled"]

_COAT = 0.25  # clear coat strength relative to the main specular lobe
_COAT_ALPHAS = 0.1, 0.001  # coat alpha at gloss 0 and 1
_SHEEN, _SHEEN_ROUGHNESS = 0.5, 0.3


def principled(source: Element, textures: Textures, document: Document) -> Material:
    """Returns the material of a `principled` or `principledthin` BSDF."""
    color, texture = textures.color(source, "base_color", 0.5)
    number = textures.number
    # Burley's specular 0.5 is an index of 1.5: F0 = 0.08 * specular.
    given = source.child("specular") is not None or source.get("specular") is not None
    ior = ior_of(0.08 * number(source, "specular", 0.5)) if given else number(source, "eta", 1.5)
    for name in ("flatness", "spec_tint"):
        if number(source, name, 0.0) > 0:
            document.ignore(
                Sentence("mitsuba-parameter-ignored", "{what}: its {name} is ignored", what=source.description, name=name)
            )
    through, sheen = unit(number(source, "spec_trans", 0.0)), unit(number(source, "sheen", 0.0))
    is_thin = source.type == "principledthin"
    if through == 1 and not is_thin and texture is None:
        color = (
            math.sqrt(color[0]),
            math.sqrt(color[1]),
            math.sqrt(color[2]),
        )  # Mitsuba applies the root at both crossings
    elif through > 0 and not is_thin:
        document.ignore(
            Sentence(
                "mitsuba-transmission-tint-differs",
                "{what}: transmitted light is tinted by the full colour at each surface",
                what=source.description,
            )
        )
    if through == 0 and not is_thin:
        # Burley's diffuse lobe is not attenuated by the specular one, unlike glTF's.
        matt = 1 - unit(number(source, "metallic", 0.0))
        color, texture = textures.scaled(color, texture, 1 + matt * (1 / (1 - dielectric_albedo(clamped(ior, 1.0, 4.0))) - 1))
    made = Material(
        kind="metallic_roughness",
        base_color=color,
        base_color_texture=texture,
        ior=clamped(ior, 1.0, ALL_REFLECTING_IOR),
        specular=0.0 if through == 0 and is_thin else 1.0,  # a thin sheet without transmission has no specular lobe
        transmission=through,
        thin=is_thin,
        clearcoat=_COAT * unit(number(source, "clearcoat", 0.0)),
        clearcoat_roughness=math.sqrt(_lerp(_COAT_ALPHAS, unit(number(source, "clearcoat_gloss", 0.0)))),
    )
    if sheen > 0:
        document.ignore(
            Sentence(
                "mitsuba-sheen-differs", "{what}: its sheen is rendered with the sheen model of glTF", what=source.description
            )
        )
        made = replace(made, sheen_color=(_SHEEN * sheen,) * 3, sheen_roughness=_SHEEN_ROUGHNESS)
    share = clamped(number(source, "diff_trans", 0.0), 0.0, 2.0) / 2 if is_thin else 0.0
    if share > 0:
        made = replace(
            made, diffuse_transmission=share, diffuse_transmission_color=color, diffuse_transmission_color_texture=texture
        )
    return _rough(made, source, textures)


def _rough(material: Material, source: Element, textures: Textures) -> Material:
    """Returns the material with the BSDF's roughness, anisotropy and metalness."""
    strength = unit(textures.number(source, "anisotropic", 0.0))
    metal, metal_texture = textures.amount(source, "metallic", 0.0)
    material = replace(material, metallic=unit(metal))
    if strength > 0:
        aspect = math.sqrt(1 - 0.9 * strength)
        alpha = unit(textures.number(source, "roughness", 0.5)) ** 2
        material = replace(material, **brushed(unit(alpha / aspect), alpha * aspect))
        rough_texture = None
    else:
        roughness, rough_texture = textures.amount(source, "roughness", 0.5)
        material = replace(material, roughness=unit(roughness))
    return replace(material, metallic_roughness_texture=textures.roughness_and_metal(rough_texture, metal_texture))


def _lerp(ends: tuple[float, float], share: float) -> float:
    return ends[0] * (1 - share) + ends[1] * share
