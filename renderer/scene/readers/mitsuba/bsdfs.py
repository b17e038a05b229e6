"""Converts Mitsuba's BSDFs to materials.

Roughness is the square root of Mitsuba's alpha; indices of refraction are relative to that of the exterior.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.scene.description import Material, SceneDescription
from renderer.scene.given_spectra import given_index
from renderer.scene.material import ALL_REFLECTING_IOR
from renderer.scene.observer import WAVELENGTHS
from renderer.scene.readers.anisotropy import brushed
from renderer.scene.readers.coats import internal_albedo, pane_ior
from renderer.scene.readers.fibres import BROWN, fibre
from renderer.scene.readers.height_maps import BumpMaps, rounded
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.material_mix import mix_materials
from renderer.scene.readers.metals import normal_reflectance
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.media import Media
from renderer.scene.readers.mitsuba.metals import CONDUCTORS
from renderer.scene.readers.mitsuba.principled import principled
from renderer.scene.readers.mitsuba.textures import Textures
from renderer.scene.readers.mitsuba.values import Spectrum, rgb
from renderer.scene.readers.number_ranges import clamped, unit
from renderer.sentences import Sentence

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
_MAX_NESTED = 16
_WRAPPERS = ("twosided", "mask", "bumpmap", "normalmap")
_LUMINANCE = (0.212671, 0.715160, 0.072169)

Spans = Callable[[], tuple[float, float] | None]


def _no_spans() -> None:
    return None


class Bsdfs:
    """Adds materials to a description. The same BSDF with the same emission gets the same index."""

    def __init__(self, document: Document, textures: Textures, media: Media, description: SceneDescription) -> None:
        self._document, self._textures, self._media, self._description = document, textures, media, description
        self._numbers: dict[tuple[Any, ...], int] = {}
        self._bumps = BumpMaps(textures.shelf, _LUMINANCE)
        self.bumpy: set[int] = set()  # materials with a normal map made from heights
        self.attributes: dict[int, str] = {}  # mesh attributes used as colour, by material
        self.inside_out: set[int] = set()  # materials with a lower index inside: their exterior is the filled side

    def material(self, shape: Element, spans: Spans = _no_spans) -> int:
        """Returns the index of a shape's material, which combines the shape's BSDF with the emission of its area emitter.

        spans: function that returns the mesh's lengths per unit of UV (height_maps.py); called only for bump maps.
        """
        source = next(iter(shape.children_of("bsdf")), None)
        emitter = next((each for each in shape.children_of("emitter") if each.type == "area"), None)
        bumps = None if source is None else _find_bump_map(source)
        found = None if bumps is None else spans()
        length = None if found is None else (rounded(found[0]), rounded(found[1]))
        is_inside_out = source is not None and self._is_inside_out(source)
        inside = self._media.inside(shape, is_inside_out)
        key = (id(source), id(emitter), length, None if inside is None else (inside.sigma_a, inside.sigma_s, inside.g))
        if key not in self._numbers:
            self._textures.attribute = ""
            grey = 0.0 if any(shape.children_of("emitter")) else 0.5  # emissive shapes are black by default
            made = self._read_bsdf(source, 0) if source is not None else Material(base_color=(grey,) * 3)
            if bumps is not None and length is not None:
                made = self._bump_mapped(bumps, made, length)
                self.bumpy.add(len(self._description.materials))
            if source is not None and source.type == "null" and emitter is not None:
                made = Material(source.id or "null", base_color=(0.0, 0.0, 0.0), lamp=True)
            elif source is not None and source.type == "null" and inside is not None:
                made = Material(source.id or "null", "interface")
            made = self._media.fill(made, inside, shape)
            if emitter is not None:
                emission, texture = self._textures.color(emitter, "radiance", 1.0, is_light=True)
                made = replace(made, emission=emission, emission_texture=texture)
            self._description.materials.append(made)
            self._numbers[key] = len(self._description.materials) - 1
            if self._textures.attribute:
                self.attributes[self._numbers[key]] = self._textures.attribute
            if is_inside_out:
                self.inside_out.add(self._numbers[key])
        return self._numbers[key]

    def _read_bsdf(self, source: Element, depth: int) -> Material:
        if depth > _MAX_NESTED:
            self._document.ignore(
                Sentence("mitsuba-bsdf-nested-too-deep", "{what} is nested too deeply: rendered grey", what=source.description)
            )
            return Material(source.id or source.type)
        source.mark_used()
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
            "hair": self._hair,
        }.get(source.type)
        name = source.id or source.type
        if make is not None:
            return replace(make(source), name=name)
        inner = source.children_of("bsdf")
        if source.type == "null":
            return Material(name, opacity=0.0, alpha_mode="blend")
        if source.type == "twosided" and inner:
            if len(inner) > 1:
                inner[1].mark_used()
                self._document.ignore(
                    Sentence(
                        "mitsuba-twosided-second-ignored",
                        "{what}: has a material for each side; both sides show the first",
                        what=source.description,
                    )
                )
            return self._read_bsdf(inner[0], depth + 1)
        if source.type == "mask" and inner:
            return self._masked(source, self._read_bsdf(inner[0], depth + 1))
        if source.type == "normalmap" and inner:
            return self._normal_mapped(source, self._read_bsdf(inner[0], depth + 1))
        if source.type == "bumpmap" and inner:
            return self._read_bsdf(inner[0], depth + 1)
        if source.type == "blendbsdf" and len(inner) > 1:
            return self._read_blend(source, inner, depth)
        if inner:
            self._document.ignore(
                Sentence(
                    "mitsuba-bsdf-wrapper-unsupported",
                    "{what} is not supported: the material inside it is rendered",
                    what=source.description,
                )
            )
            return self._read_bsdf(inner[0], depth + 1)
        self._document.ignore(
            Sentence(
                "bsdf-type-unsupported", "{what} is not supported: rendered as a grey diffuse surface", what=source.description
            )
        )
        return Material(name, base_color=(0.5, 0.5, 0.5))

    def _read_blend(self, source: Element, inner: list[Element], depth: int) -> Material:
        weight = unit(self._textures.number(source, "weight", 0.5))
        first, second = (self._read_bsdf(each, depth + 1) for each in inner[:2])
        made = mix_materials(first, second, weight)
        if made is None:
            self._document.ignore(
                Sentence(
                    "bsdf-blend-unsupported",
                    "{what} blends materials that cannot be blended here: the one with the larger weight is rendered",
                    what=source.description,
                )
            )
            return second if weight > 0.5 else first
        return replace(made, name=source.id or source.type)

    def _is_inside_out(self, source: Element) -> bool:
        """Returns True if a BSDF is glass whose index of refraction is lower inside than outside, as for a bubble in water.

        Wrappers around the glass (mask, normalmap) are looked through.
        """
        if source.type in ("dielectric", "roughdielectric"):
            return self._ior(source, "int_ior", "bk7") < self._ior(source, "ext_ior", "air")
        inner = source.children_of("bsdf")
        return source.type in ("mask", "normalmap") and bool(inner) and self._is_inside_out(inner[0])

    def _diffuse(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "reflectance", 0.5)
        if source.type == "roughdiffuse" and source.number("alpha", 0.2) > 0:
            self._document.ignore(
                Sentence(
                    "mitsuba-diffuse-roughness-ignored",
                    "{what}: its diffuse roughness is ignored",
                    what=source.description,
                )
            )
        return Material(base_color=color, base_color_texture=texture)

    def _glass(self, source: Element) -> Material:
        inside, outside = self._ior(source, "int_ior", "bk7"), self._ior(source, "ext_ior", "air")
        color, texture = self._textures.color(source, "specular_transmittance", 1.0)
        if rgb(source.get("specular_reflectance", 1.0)) != (1.0, 1.0, 1.0):
            self._document.ignore(
                Sentence("mitsuba-specular-colour-ignored", "{what}: its specular colour is ignored", what=source.description)
            )
        ior = max(inside / outside, outside / inside)
        is_thin = source.type == "thindielectric"
        rough = self._roughness_fields(source, 0.1) if source.type == "roughdielectric" else {"roughness": 0.0}
        return Material(
            kind="glass",
            base_color=color,
            base_color_texture=texture,
            ior=clamped(pane_ior(ior) if is_thin else ior, 1.0, ALL_REFLECTING_IOR),
            thin=is_thin,
            **rough,
        )

    def _metal(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "specular_reflectance", 1.0)
        rough = self._roughness_fields(source, 0.1, brushes=True) if source.type == "roughconductor" else {"roughness": 0.0}
        named = source.get("material")
        if named is None and source.get("eta") is None and source.get("k") is None:
            named = "Cu" if self._document.is_old else "none"
        if named == "none":
            if rough["roughness"] == 0:
                return Material(kind="mirror", base_color=color, base_color_texture=texture)
            return Material(kind="metallic_roughness", base_color=color, base_color_texture=texture, metallic=1.0, **rough)
        if named is not None:
            known = CONDUCTORS.get(str(named).partition("_")[0])
            if known is None:
                self._document.ignore(
                    Sentence(
                        "mitsuba-conductor-unknown",
                        "{what}: the metal {metal} is unknown; rendered as aluminium",
                        what=source.description,
                        metal=str(named)[:40],
                    )
                )
            eta, k = known or CONDUCTORS["Al"]
            if source.get("ext_eta") is not None:
                outside = self._ior(source, "ext_eta", "air")
                eta, k = tuple(v / outside for v in eta), tuple(v / outside for v in k)  # type: ignore[assignment]
        else:
            eta, k = rgb(source.get("eta", 0.0)), rgb(source.get("k", 1.0))
            outside = self._ior(source, "ext_eta", "air")
            eta, k = tuple(v / outside for v in eta), tuple(v / outside for v in k)  # type: ignore[assignment]
            spectra = source.get("eta"), source.get("k")
            if all(isinstance(each, Spectrum) for each in spectra):
                self._textures.shelf.spectra.extend(given_index(eta, k, *(each.at(WAVELENGTHS) / outside for each in spectra)))
        if color == (1.0, 1.0, 1.0) and texture is None:
            return Material(kind="conductor", eta=eta, k=k, **rough)
        r, g, b = (unit(c * head) for c, head in zip(color, normal_reflectance(eta, k), strict=True))
        return Material(kind="metallic_roughness", base_color=(r, g, b), base_color_texture=texture, metallic=1.0, **rough)

    def _plastic(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "diffuse_reflectance", 0.5)
        inside, outside = self._ior(source, "int_ior", "polypropylene"), self._ior(source, "ext_ior", "air")
        ior = clamped(inside / outside, 1.0, ALL_REFLECTING_IOR)
        nonlinear = source.boolean("nonlinear", False)
        painted: dict[str, Any] = {"base_color": color, "base_color_texture": texture, "ior": ior}
        if source.type != "plastic":
            shine, _ = self._textures.color(source, "specular_reflectance", 1.0)
            return Material(
                kind="plastic", specular_color=shine, nonlinear=nonlinear, **painted, **self._roughness_fields(source, 0.1)
            )
        if nonlinear:
            color, texture = self._textures.coated(color, texture, internal_albedo(ior))
            painted.update(base_color=color, base_color_texture=texture)
        return Material(kind="metallic_roughness", roughness=0.0, **painted)

    def _principled(self, source: Element) -> Material:
        return principled(source, self._textures, self._document)

    def _phong(self, source: Element) -> Material:
        color, texture = self._textures.color(source, "diffuse_reflectance", 0.5)
        shine, pattern = self._textures.color(source, "specular_reflectance", 0.2)
        if pattern is not None:
            self._document.ignore(
                Sentence(
                    "mitsuba-specular-texture-averaged",
                    "specular_reflectance of {what} is a texture: its mean is used",
                    what=source.description,
                )
            )
            r, g, b = (unit(float(v)) for v in linear(self._textures.shelf.image_of(pattern))[..., :3].mean(axis=(0, 1)))
            shine = r, g, b
        exponent = min(max(source.number("exponent", 30.0), 0.0), 1e6)
        return Material(
            kind="blinn_phong", base_color=color, base_color_texture=texture, specular_color=shine, shininess=exponent
        )

    def _hair(self, source: Element) -> Material:
        along, around = (source.number(f"{name}_roughness", 0.3) for name in ("longitudinal", "azimuthal"))
        ior = self._ior(source, "int_ior", "amber") / self._ior(source, "ext_ior", "air")
        shape = along, around, math.radians(source.number("scale_tilt", 2.0)), ior
        if source.get("sigma_a") is not None or source.child("sigma_a") is not None:
            scale = source.number("scale", 1.0)
            return fibre(*shape, scale * np.array(self._textures.color(source, "sigma_a", 0.0)[0]))
        brown, red = source.number("eumelanin", BROWN), source.number("pheomelanin", 0.2)
        return fibre(*shape, eumelanin=brown, pheomelanin=red)

    def _masked(self, source: Element, inner: Material) -> Material:
        texture = source.child("opacity")
        if texture is None:
            opacity = rgb(source.get("opacity", 0.5))
            if len({*opacity}) > 1:
                self._document.ignore(
                    Sentence(
                        "mitsuba-opacity-colour-averaged",
                        "{what}: its opacity is a colour; its mean is used",
                        what=source.description,
                    )
                )
            return replace(inner, opacity=unit(sum(opacity) / 3), alpha_mode="blend")
        mask = self._textures.texture(texture, False)
        if mask is None:
            return replace(inner, opacity=0.5, alpha_mode="blend")
        return replace(inner, base_color_texture=self._textures.cut_out(inner.base_color_texture, mask), alpha_mode="blend")

    def _normal_mapped(self, source: Element, inner: Material) -> Material:
        texture = source.child("normalmap") or next(iter(source.children_of("texture")), None)
        if source.boolean("use_shadowing_function", True):
            self._document.ignore(
                Sentence(
                    "mitsuba-normal-map-shadowing",
                    "Normal maps have no shadowing function here; to compare, set it to false in Mitsuba",
                )
            )
        return inner if texture is None else replace(inner, normal_texture=self._textures.texture(texture, False))

    def _bump_mapped(self, source: Element, material: Material, spans: tuple[float, float]) -> Material:
        textures = source.children_of("texture")
        heights = None if not textures else self._textures.texture(textures[0], False)
        found = None if heights is None else self._bumps.normal_map(heights, source.number("scale", 1.0), spans)
        if found is None:
            return material
        return replace(material, normal_texture=found.texture, normal_scale=found.strength)

    def _roughness_fields(self, source: Element, default: float, brushes: bool = False) -> dict[str, Any]:
        """Returns the material fields of a BSDF's microfacet distribution, roughness and anisotropy.

        default: the default of alpha. brushes: whether anisotropy is supported for this BSDF; if not, it is ignored with a note.
        """
        named = str(source.get("distribution", "beckmann"))
        if named not in ("ggx", "beckmann"):
            self._document.ignore(
                Sentence(
                    "mitsuba-microfacet-replaced",
                    "{what}: its distribution {distribution} is replaced by Beckmann with the same alpha",
                    what=source.description,
                    distribution=repr(named[:40]),
                )
            )
        facets: dict[str, Any] = {"distribution": "ggx" if named == "ggx" else "beckmann"}
        if any(source.child(name) is not None or source.get(name) is not None for name in ("alpha_u", "alpha_v")):
            along, across = (unit(self._textures.number(source, name, default)) for name in ("alpha_u", "alpha_v"))
            if brushes or along == across:
                return facets | brushed(along, across)
            self._document.ignore(
                Sentence(
                    "anisotropy-ignored",
                    "{what}: its anisotropic roughness is not supported; it is equally rough in both directions",
                    what=source.description,
                )
            )
            return facets | {"roughness": math.sqrt(math.sqrt(along * across))}
        roughness, texture = self._textures.amount(source, "alpha", default, 0.5)
        packed = None if texture is None else self._textures.roughness_and_metal(texture, None)
        return facets | {"roughness": unit(roughness), "metallic_roughness_texture": packed}

    def _ior(self, source: Element, name: str, default: str) -> float:
        found = source.get(name, default)
        if isinstance(found, str):
            if found.lower() not in _IORS:
                self._document.ignore(
                    Sentence(
                        "mitsuba-ior-name-unknown",
                        "{what}: the material {material} is unknown; an index of refraction of 1.5 is used",
                        what=source.description,
                        material=repr(found[:40]),
                    )
                )
            return _IORS.get(found.lower(), 1.5)
        return max(source.number(name, _IORS[default]), 1e-3)


def _find_bump_map(source: Element) -> Element | None:
    """Returns the bumpmap element that is a BSDF, or that the BSDF's wrappers contain; None if there is none."""
    found: Element | None = source
    for _ in range(_MAX_NESTED):
        if found is None or found.type == "bumpmap" or found.type not in _WRAPPERS:
            break
        found = next(iter(found.children_of("bsdf")), None)
    return found if found is not None and found.type == "bumpmap" else None
