"""Mitsuba's BSDFs as materials. Roughness is the square root of Mitsuba's alpha; indices are relative to what lies outside."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from renderer.scene.description import Material, SceneDescription
from renderer.scene.material import ALL_REFLECTING_IOR
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.textures import Textures
from renderer.scene.readers.mitsuba.values import rgb

__all__ = ["Bsdfs"]

# Indices of refraction by Mitsuba's names. Source: its documentation, plugin "dielectric".
_IORS = {
    "vacuum": 1.0,
    "air": 1.000277,
    "helium": 1.00004,
    "hydrogen": 1.00013,
    "carbon dioxide": 1.00045,
    "water": 1.333,
    "water ice": 1.31,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "fused quartz": 1.458,
    "pyrex": 1.47,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.575,
    "diamond": 2.419,
}
_METALS = {
    "Al": "aluminium",
    "Au": "gold",
    "Ag": "silver",
    "Cr": "chromium",
    "Cu": "copper",
    "W": "tungsten",
    "Ni": "nickel",
    "Pt": "platinum",
    "Ti": "titanium",
    "Fe": "iron",
}
_MAX_NESTED = 16


class Bsdfs:
    """Adds materials to a description; the same BSDF with the same light gives the same number again."""

    def __init__(self, document: Document, textures: Textures, description: SceneDescription) -> None:
        self._document, self._textures, self._description = document, textures, description
        self._numbers: dict[tuple[Any, ...], int] = {}

    def material(self, shape: Element) -> int:
        """The material of a shape: of its BSDF, with the light of its area emitter."""
        source = next(iter(shape.of("bsdf")), None)
        emitter = next((each for each in shape.of("emitter") if each.type == "area"), None)
        key = (id(source), id(emitter))
        if key not in self._numbers:
            made = self._made(source, 0) if source is not None else Material(base_color=(0.5, 0.5, 0.5))
            if emitter is not None:
                emission, texture = self._textures.color(emitter, "radiance", 1.0, is_light=True)
                made = replace(made, emission=emission, emission_texture=texture)
            self._description.materials.append(made)
            self._numbers[key] = len(self._description.materials) - 1
        return self._numbers[key]

    def _made(self, source: Element, depth: int) -> Material:
        if depth > _MAX_NESTED:
            self._document.ignore(f"{source.what} is nested too deep: rendered grey")
            return Material(source.id or source.type)
        make = {
            "diffuse": self._diffuse,
            "roughdiffuse": self._diffuse,
            "dielectric": self._glass,
            "roughdielectric": self._glass,
            "thindielectric": self._glass,
            "conductor": self._metal,
            "roughconductor": self._metal,
            "plastic": self._plastic,
            "roughplastic": self._plastic,
            "pplastic": self._plastic,
            "principled": self._principled,
            "principledthin": self._principled,
            "phong": self._phong,
        }.get(source.type)
        name = source.id or source.type
        if make is not None:
            return replace(make(source), name=name)
        inner = source.of("bsdf")
        if source.type == "null":
            return Material(name, opacity=0.0, alpha_mode="blend")
        if source.type == "twosided" and inner:
            if len(inner) > 1:
                self._document.ignore(f"{source.what}: has a material of its own for each side; both show the first")
            return self._made(inner[0], depth + 1)
        if source.type == "mask" and inner:
            return self._masked(source, self._made(inner[0], depth + 1))
        if source.type == "normalmap" and inner:
            return self._bent(source, self._made(inner[0], depth + 1))
        if source.type == "blendbsdf" and len(inner) > 1:
            weight = self._textures.number(source, "weight", 0.5)
            self._document.ignore(f"{source.what} mixes two materials: the one that counts for more is rendered")
            return self._made(inner[1] if weight > 0.5 else inner[0], depth + 1)
        if inner:
            self._document.ignore(f"{source.what} is not read: rendered by the material in it")
            return self._made(inner[0], depth + 1)
        self._document.ignore(f"{source.what} is not read: rendered as a grey matt surface")
        return Material(name, base_color=(0.5, 0.5, 0.5))

    def _diffuse(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "reflectance", 0.5)
        if source.type == "roughdiffuse" and source.number("alpha", 0.2) > 0:
            self._document.ignore(f"{source.what}: rendered as a matt surface without the roughness of its own")
        return Material(base_color=color, base_color_texture=texture)

    def _glass(self, source: Element) -> Material:
        inside, outside = self._ior(source, "int_ior", "bk7"), self._ior(source, "ext_ior", "air")
        color, texture = self._textures.color(source, "specular_transmittance", 1.0)
        if rgb(source.get("specular_reflectance", 1.0)) != (1.0, 1.0, 1.0):
            self._document.ignore(f"{source.what}: the colour of its reflection is not taken over")
        is_thin = source.type == "thindielectric"
        return Material(
            kind="glass",
            base_color=color,
            base_color_texture=texture,
            ior=min(max(inside / outside if inside >= outside else outside / inside, 1.0), ALL_REFLECTING_IOR),
            roughness=self._roughness(source, 0.1) if source.type == "roughdielectric" else 0.0,
            thin=is_thin,
        )

    def _metal(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "specular_reflectance", 1.0)
        roughness = self._roughness(source, 0.1) if source.type == "roughconductor" else 0.0
        named = source.get("material")
        if named is None and source.get("eta") is None and source.get("k") is None:
            named = "none" if source.type == "conductor" else "Cu"
        if named == "none":
            if roughness == 0:
                return Material(kind="mirror", base_color=color, base_color_texture=texture)
            return Material(
                kind="metallic_roughness", base_color=color, base_color_texture=texture, metallic=1.0, roughness=roughness
            )
        if named is not None:
            known = _METALS.get(str(named).partition("_")[0])
            if known is None:
                self._document.ignore(f"{source.what}: the metal {str(named)[:40]} is not known here; rendered as aluminium")
            eta, k = METALS[known or "aluminium"]
        else:
            eta, k = rgb(source.get("eta", 0.0)), rgb(source.get("k", 1.0))
            outside = self._ior(source, "ext_eta", "air")
            eta, k = tuple(v / outside for v in eta), tuple(v / outside for v in k)  # type: ignore[assignment]
        if color != (1.0, 1.0, 1.0) or texture is not None:
            self._document.ignore(f"{source.what}: the colour that its reflection is multiplied by is not taken over")
        return Material(kind="conductor", eta=eta, k=k, roughness=roughness)

    def _plastic(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "diffuse_reflectance", 0.5)
        inside, outside = self._ior(source, "int_ior", "polypropylene"), self._ior(source, "ext_ior", "air")
        return Material(
            kind="metallic_roughness",
            base_color=color,
            base_color_texture=texture,
            ior=min(max(inside / outside, 1.0), ALL_REFLECTING_IOR),
            roughness=0.0 if source.type == "plastic" else self._roughness(source, 0.1),
        )

    def _principled(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "base_color", 0.5)
        number = self._textures.number
        specular = source.get("specular")
        # Burley's specular of 0.5 is an index of 1.5: F0 = 0.08 specular.
        ior = source.number("eta", 1.5) if specular is None else _ior_of(0.08 * number(source, "specular", 0.5))
        for name in ("flatness", "spec_tint", "diff_trans"):
            if number(source, name, 0.0) > 0:
                self._document.ignore(f"{source.what}: its {name} is not taken over")
        sheen = number(source, "sheen", 0.0)
        return Material(
            kind="metallic_roughness",
            base_color=color,
            base_color_texture=texture,
            metallic=_unit(number(source, "metallic", 0.0)),
            roughness=_unit(number(source, "roughness", 0.5)),
            ior=min(max(ior, 1.0), ALL_REFLECTING_IOR),
            transmission=_unit(number(source, "spec_trans", 0.0)),
            thin=source.type == "principledthin",
            anisotropy=_unit(number(source, "anisotropic", 0.0)),
            clearcoat=_unit(number(source, "clearcoat", 0.0)),
            clearcoat_roughness=_unit(1 - number(source, "clearcoat_gloss", 0.0)),
            sheen_color=(_unit(sheen),) * 3,
            sheen_roughness=0.5 if sheen > 0 else 0.0,
        )

    def _phong(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "diffuse_reflectance", 0.5)
        shine, _ = self._textures.color(source, "specular_reflectance", 0.2)
        exponent = min(max(source.number("exponent", 30.0), 0.0), 1e6)
        return Material(
            kind="blinn_phong", base_color=color, base_color_texture=texture, specular_color=shine, shininess=exponent
        )

    def _masked(self, source: Element, inner: Material) -> Material:
        texture = source.child("opacity")
        if texture is None:
            return replace(inner, opacity=_unit(rgb(source.get("opacity", 0.5))[0]), alpha_mode="blend")
        mask = self._textures.texture(texture, False)
        if mask is None:
            return replace(inner, opacity=0.5, alpha_mode="blend")
        return replace(inner, base_color_texture=self._textures.cut_out(inner.base_color_texture, mask), alpha_mode="blend")

    def _bent(self, source: Element, inner: Material) -> Material:
        texture = source.child("normalmap") or next(iter(source.of("texture")), None)
        if source.flag("use_shadowing_function", True):
            self._document.ignore(
                "Normal maps are not darkened by a shadowing function here; to compare, set it to false in Mitsuba"
            )
        return inner if texture is None else replace(inner, normal_texture=self._textures.texture(texture, False))

    def _roughness(self, source: Element, default: float) -> float:
        """Of a microfacet distribution of GGX; of Beckmann's, as rough."""
        if source.get("alpha_u") is not None or source.get("alpha_v") is not None:
            u, v = source.number("alpha_u", default), source.number("alpha_v", default)
            self._document.ignore(f"{source.what}: it is as rough in both directions here")
            return _unit(math.sqrt(math.sqrt(max(u * v, 0.0))))
        if source.get("distribution", "beckmann") != "ggx":
            self._document.ignore(f"{source.what}: its distribution is rendered as GGX with the same alpha")
        return _unit(math.sqrt(max(self._textures.number(source, "alpha", default), 0.0)))

    def _ior(self, source: Element, name: str, default: str) -> float:
        found = source.get(name, default)
        if isinstance(found, str):
            if found.lower() not in _IORS:
                self._document.ignore(f"{source.what}: the material {found[:40]!r} is not known here; its index is taken as 1.5")
            return _IORS.get(found.lower(), 1.5)
        return max(source.number(name, _IORS[default]), 1e-3)


def _unit(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _ior_of(reflectance: float) -> float:
    """The index by which normal incidence reflects so much."""
    root = math.sqrt(min(max(reflectance, 0.0), 0.99))
    return (1 + root) / (1 - root)
