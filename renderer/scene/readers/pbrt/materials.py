"""Converts pbrt's materials.

pbrt's alpha is the square root of its roughness unless remapping is off; roughness here is the square root of alpha.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from renderer.scene.description import Image, Material, SceneDescription, Vec3
from renderer.scene.readers.anisotropy import brushed
from renderer.scene.readers.coats import pane_ior
from renderer.scene.readers.height_maps import BumpMaps
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.material_mix import mix_materials
from renderer.scene.readers.metals import normal_reflectance
from renderer.scene.readers.pbrt.coats import coat_of, coated_albedo, coated_metal_reflectance
from renderer.scene.readers.pbrt.conductors import absorbing, index_of, index_of_reflectance
from renderer.scene.readers.pbrt.hair import hair
from renderer.scene.readers.pbrt.mappings import Mapping
from renderer.scene.readers.pbrt.media import Interface, Media, subsurface
from renderer.scene.readers.pbrt.notes import Notes, Place
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.textures import Textures, Varying
from renderer.sentences import Sentence

__all__ = ["Emission", "Materials", "is_nothing"]

_HALF: Vec3 = (0.5, 0.5, 0.5)
_NO_LIGHT: Vec3 = (0.0, 0.0, 0.0)
_SMOOTH = 1e-3  # alpha below which pbrt's surfaces are perfectly specular
_MAX_NESTED = 16
_IGNORED = ("maxdepth", "nsamples")


@dataclass(frozen=True)
class Emission:
    """The emission of a surface: its radiance, an optional texture that multiplies it, and whether both sides emit."""

    radiance: Vec3 = _NO_LIGHT
    texture: int | None = None
    both_sides: bool = False


def is_nothing(source: Parameters | None) -> bool:
    """Returns True if a material is pbrt's invisible boundary of a medium, which does not refract."""
    return source is not None and source.type in ("interface", "", "none")


class Materials:
    """Adds materials to a description. The same material with the same emission and alpha gets the same index."""

    def __init__(self, textures: Textures, media: Media, description: SceneDescription, notes: Notes) -> None:
        self._textures, self._media, self._description, self._notes = textures, media, description, notes
        self.named: dict[str, Parameters] = {}
        self._numbers: dict[tuple[Any, ...], int] = {}
        self._made: dict[int, Material] = {}
        self._ways: dict[int, tuple[Mapping, ...]] = {}
        self._heights: dict[int, Varying] = {}  # height texture by material
        self._bumps = BumpMaps(textures.shelf)
        self.mappings: dict[int, Mapping] = {}  # by material index, for textures without UV mapping

    def bounds_media(self, between: Interface, place: Place) -> bool:
        """Returns True if a surface separates two different media. between: names of the media inside and outside."""
        return self._media.bounds(between, place)

    def displaced(self, number: int, texture: int, scale: float) -> int:
        """Returns the index of a material like that of index `number` that displaces meshes by a texture times `scale`."""
        key = (number, texture, scale)
        if key not in self._numbers:
            made = replace(self._description.materials[number], displacement_texture=texture, displacement_scale=scale)
            self._description.materials.append(made)
            self._numbers[key] = len(self._description.materials) - 1
            if number in self.mappings:
                self.mappings[self._numbers[key]] = self.mappings[number]
        return self._numbers[key]

    def heights(self, source: Parameters | None) -> Varying | None:
        """Returns the height texture of a material; None without one."""
        if source is None or is_nothing(source):
            return None
        self.material_of(source, 0)
        return self._heights.get(id(source))

    def number(
        self,
        source: Parameters | None,
        emission: Emission,
        alpha: Varying,
        place: Place,
        between: Interface = ("", ""),
        spans: tuple[float, float] | None = None,
    ) -> int:
        """Returns the index, in the scene description, of a shape's material; adds the material if needed.

        alpha: opacity; place: position of the shape in the file; between: names of the media inside and outside; spans: lengths
        per unit of UV (height_maps.py), for shapes with a height texture.
        """
        key = (id(source), emission, alpha, between, spans)
        if key not in self._numbers:
            made = Material(base_color=_HALF) if source is None else self.material_of(source, 0)
            if source is not None and spans is not None:
                made = self._bump_mapped(source, made, spans)
            if is_nothing(source) and max(emission.radiance) > 0:
                made = Material(base_color=_NO_LIGHT, lamp=True)
            made = self._media.fill(made, source, between, place)
            is_lamp = alpha.is_constant and alpha.value[0] <= 0
            made = replace(made, lamp=True, unseen=True) if is_lamp else self._with_alpha(made, alpha, source)
            made = replace(made, emission=emission.radiance, emission_texture=emission.texture, double_sided=emission.both_sides)
            self._description.materials.append(made)
            self._numbers[key] = len(self._description.materials) - 1
            ways = [*self._ways.get(id(source), ()), *([alpha.mapping] if alpha.mapping is not None else [])]
            if ways:
                self.mappings[self._numbers[key]] = ways[0]
            if source is not None and len(set(ways)) > 1:
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-material-mappings-differ",
                        "The textures of {source} have different mappings: all use the first",
                        source=source,
                    ),
                )
        return self._numbers[key]

    def material_of(self, source: Parameters, depth: int) -> Material:
        """Returns a material without emission and alpha. depth: nesting level of mixed materials."""
        if id(source) not in self._made:
            before = len(self._textures.mappings)
            self._made[id(source)] = self._read_material(source, depth)
            self._ways[id(source)] = tuple(self._textures.mappings[before:])
        else:
            self._textures.mappings += self._ways[id(source)]
        return self._made[id(source)]

    def _read_material(self, source: Parameters, depth: int) -> Material:
        if depth > _MAX_NESTED:
            raise source.place.error(
                Sentence(
                    "pbrt-materials-nested-too-deep", "{source} is made of materials that are nested too deeply", source=source
                )
            )
        make = {
            "diffuse": self._diffuse,
            "coateddiffuse": self._coated,
            "conductor": self._conductor,
            "coatedconductor": self._coated_conductor,
            "dielectric": self._glass,
            "thindielectric": self._glass,
            "diffusetransmission": self._diffuse_transmission,
            "hair": self._hair,
            "subsurface": self._subsurface,
        }.get(source.type)
        if source.type == "mix":
            return self._mix(source, depth)
        if make is None:
            made = self._substitute(source)
        else:
            made = make(source)
        source.used.update(_IGNORED)
        return self._normal_mapped(source, replace(made, name=source.type))

    def _diffuse(self, source: Parameters) -> Material:
        return _diffuse_material(self._textures.color(source, "reflectance", _HALF))

    def _coated(self, source: Parameters) -> Material:
        """Returns a coated diffuse material with the effective reflectance of its base."""
        color = self._textures.color(source, "reflectance", _HALF)
        ior, _ = self._textures.colors.index(self._textures.index(source, "eta"))
        ior = min(max(ior, 1.0), 4.0)
        self._medium(source)
        rough = self._roughness_fields(source, "")
        coat = coat_of(ior, self._mean_alpha(rough), self._thickness(source), min(max(source.integer("maxdepth", 10), 1), 1000))
        if color.texture is None:
            color = Varying(coated_albedo(color.value, coat))
        else:
            factor = color.value
            texture = self._textures.shelf.derived_texture(
                color.texture,
                f"under a coat {coat} by {factor}",
                lambda it: Image(f"{it.name} coated", coated_albedo(linear(it) * np.array(factor, np.float32), coat), False),
            )
            color = Varying((1.0, 1.0, 1.0), texture)
        return replace(_diffuse_material(color), kind="metallic_roughness", ior=ior, **rough)

    def _thickness(self, source: Parameters) -> float:
        return min(max(self._textures.one_number(source, "thickness", 0.01), 0.0), 100.0)

    def _mean_alpha(self, rough: dict[str, Any]) -> float:
        """Returns the mean microfacet alpha of a coat: over its roughness texture, and over both axes if it is anisotropic.

        rough: the coat's roughness and anisotropy, as material fields.
        """
        least: float = rough["roughness"] ** 2
        texture = rough.get("metallic_roughness_texture")
        if texture is not None:
            least = float((linear(self._textures.shelf.image_of(texture))[..., 1] ** 2).mean(dtype=np.float64))
        most = least + (1 - least) * rough.get("anisotropy", 0.0) ** 2
        return round(math.sqrt(least * most), 4)

    def _conductor(self, source: Parameters) -> Material:
        rough = self._roughness_fields(source, "")
        if source.get("reflectance") is None:
            eta, k = self._eta_and_k(source, "")
            return Material(kind="conductor", eta=eta, k=k, **rough)
        color = self._textures.color(source, "reflectance", _HALF)
        if color.is_constant:
            eta, k = index_of_reflectance(color.value)
            return Material(kind="conductor", eta=eta, k=k, **rough)
        return replace(_diffuse_material(color), kind="metallic_roughness", metallic=1.0, **rough)

    def _eta_and_k(self, source: Parameters, prefix: str) -> tuple[Vec3, Vec3]:
        eta, k = (self._textures.index(source, f"{prefix}{each}") for each in ("eta", "k"))
        return index_of(eta, k, self._textures.colors)

    def _coated_conductor(self, source: Parameters) -> Material:
        self._medium(source)
        ior, _ = self._textures.colors.index(self._textures.index(source, "interface.eta"))
        ior = ior if ior > 0 else 1.0
        thickness = self._thickness(source)

        def reflectance_under_coat(eta: np.ndarray, k: np.ndarray) -> np.ndarray:
            return coated_metal_reflectance(normal_reflectance(eta / ior, k / ior), ior, thickness)

        if source.get("reflectance") is not None:
            color = self._textures.color(source, "reflectance", _HALF)
            if color.texture is None:
                r, g, b = (float(v) for v in reflectance_under_coat(*(np.array(v) for v in index_of_reflectance(color.value))))
                color = Varying((r, g, b))
            else:
                factor = np.array(color.value, np.float32)
                texture = self._textures.shelf.derived_texture(
                    color.texture,
                    f"metal under a coat of {ior} and {thickness} by {color.value}",
                    lambda it: Image(
                        f"{it.name} coated",
                        reflectance_under_coat(np.ones(1), absorbing(linear(it) * factor)).astype(np.float32),
                        False,
                    ),
                )
                color = Varying((1.0, 1.0, 1.0), texture)
        else:
            eta, k = (np.array(v) for v in self._eta_and_k(source, "conductor."))
            r, g, b = (float(v) for v in reflectance_under_coat(eta, k))
            color = Varying((r, g, b))
        coat = self._roughness_fields(source, "interface.")
        self._notes.add(
            source.place,
            Sentence(
                "pbrt-coated-conductor-replaced",
                "coatedconductor is rendered as a metal under a clear coat of index 1.5, with "
                "interreflection as at normal incidence",
            ),
        )
        metal = self._roughness_fields(source, "conductor.")
        clear = float(coat.get("roughness", 0.0))
        return replace(
            _diffuse_material(color), kind="metallic_roughness", metallic=1.0, clearcoat=1.0, clearcoat_roughness=clear, **metal
        )

    def _glass(self, source: Parameters) -> Material:
        ior, dispersion = self._textures.colors.index(self._textures.index(source, "eta"))
        if not ior > 0:
            raise source.place.error(
                Sentence(
                    "pbrt-ior-invalid",
                    "{source} has the index of refraction {ior}; it must be above 0",
                    source=source,
                    ior=f"{ior:g}",
                )
            )
        if ior < 1:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-ior-below-one", "{source}: an index of refraction below 1 is replaced by its inverse", source=source
                ),
            )
        thin = source.type == "thindielectric"
        rough = {} if thin else self._roughness_fields(source, "", brushes=False)
        return Material(
            kind="glass",
            base_color=(1.0, 1.0, 1.0),
            ior=min(pane_ior(max(ior, 1 / ior)) if thin else max(ior, 1 / ior), 1000.0),
            dispersion=min(dispersion, 20.0),
            thin=thin,
            **rough,
        )

    def _diffuse_transmission(self, source: Parameters) -> Material:
        back = self._textures.color(source, "reflectance", (0.25,) * 3)
        through = self._textures.color(source, "transmittance", (0.25,) * 3)
        scale = min(max(source.number("scale", 1.0), 0.0), 1e6)
        tops = []
        for each in (back, through):
            top = max(each.value) if each.is_constant else 0.5 * max(each.value)
            tops.append(scale * top)
        share = tops[1] / sum(tops) if sum(tops) > 0 else 0.0
        colors = []
        for each, part in ((back, 1 - share), (through, share)):
            factor = scale / part if part > 0 else 0.0
            r, g, b = (min(v * factor, 1.0) for v in each.value)
            colors.append((r, g, b))
        return Material(
            kind="metallic_roughness",
            base_color=colors[0],
            base_color_texture=back.texture,
            specular=0.0,
            diffuse_transmission=share,
            diffuse_transmission_color=colors[1],
            diffuse_transmission_color_texture=through.texture,
        )

    def _hair(self, source: Parameters) -> Material:
        return hair(source, self._textures)

    def _subsurface(self, source: Parameters) -> Material:
        return replace(subsurface(source, self._textures, self._notes), **self._roughness_fields(source, ""))

    def _mix(self, source: Parameters, depth: int) -> Material:
        names = source.texts("materials")
        parts = [self.named.get(name) for name in names]
        if len(parts) != 2 or None in parts:
            missing = [name for name, part in zip(names, parts, strict=True) if part is None]
            raise source.place.error(
                Sentence(
                    "pbrt-mix-material-missing",
                    "{material} needs the names of two materials defined before it; there is no {missing}",
                    material=str(source),
                    missing=repr(missing[0][:60]),
                )
                if missing
                else Sentence(
                    "pbrt-mix-material-count",
                    "{material} needs the names of two materials defined before it",
                    material=str(source),
                )
            )
        amount = min(max(self._textures.one_number(source, "amount", 0.5), 0.0), 1.0)
        first, second = (self.material_of(part, depth + 1) for part in parts if part is not None)
        made = mix_materials(first, second, amount)
        if made is None:
            self._notes.add(
                source.place,
                Sentence(
                    "bsdf-blend-unsupported",
                    "{what} blends materials that cannot be blended here: the one with the larger weight is rendered",
                    what=source,
                ),
            )
            return second if amount > 0.5 else first
        return made

    def _substitute(self, source: Parameters) -> Material:
        """Returns an invisible boundary for pbrt's `interface`, and grey diffuse, with a note, for unsupported materials."""
        if is_nothing(source):
            return Material(kind="interface")
        self._notes.add(
            source.place,
            Sentence("bsdf-type-unsupported", "{what} is not supported: rendered as a grey diffuse surface", what=source),
        )
        source.used.update(source.values)
        return Material(base_color=_HALF)

    def _normal_mapped(self, source: Parameters, material: Material) -> Material:
        wanted = source.text("normalmap")
        heights = self._textures.number(source, "displacement", 0.0)
        if heights.texture is not None and not wanted:
            self._heights[id(source)] = heights
        if not wanted:
            return material
        texture = self._textures.normals(wanted, source)
        return material if texture is None else replace(material, normal_texture=texture)

    def _bump_mapped(self, source: Parameters, material: Material, spans: tuple[float, float]) -> Material:
        heights = self._heights[id(source)]
        assert heights.texture is not None
        found = self._bumps.normal_map(heights.texture, heights.value[0], spans)
        return material if found is None else replace(material, normal_texture=found.texture, normal_scale=found.strength)

    def _medium(self, source: Parameters) -> None:
        albedo = source.get("albedo")
        if source.number("g", 0.0) != 0 or (
            albedo is not None
            and (
                albedo.type == "texture"
                or self._textures.mean_value(self._textures.color(source, "albedo", _NO_LIGHT)) != _NO_LIGHT
            )
        ):
            self._notes.add(
                source.place,
                Sentence("pbrt-coat-medium-ignored", "{source}: the medium within its coat is ignored", source=source),
            )

    def _roughness_fields(self, source: Parameters, prefix: str, brushes: bool = True) -> dict[str, Any]:
        """Returns the roughness and anisotropy as material fields. prefix: of the parameters' names."""
        remaps = source.boolean("remaproughness", True)
        power = 0.25 if remaps else 0.5  # our roughness is the root of alpha
        name = f"{prefix}roughness"
        u, v = (f"{prefix}{axis}roughness" for axis in "uv")
        if source.get(u) is None and source.get(v) is None:
            found = self._textures.number(source, name, 0.0)
            if found.is_constant:
                return {"roughness": our_roughness(found.value[0], power)}
            factor = found.value[0]
            texture = self._textures.shelf.derived_texture(
                found.texture,
                f"roughness by {factor} to {power}",
                lambda it: Image(
                    f"{it.name} roughness", np.clip(linear(it) * np.float32(factor), 0, 1) ** np.float32(power), False
                ),
            )
            return {"roughness": 1.0, "metallic_roughness_texture": self._textures.without_metal(texture)}
        source.used.add(name)
        rough = [our_roughness(self._textures.one_number(source, each, 0.0), power) for each in (u, v)]
        along, across = (value**2 for value in rough)
        if not brushes and along != across:
            self._notes.add(
                source.place,
                Sentence(
                    "anisotropy-ignored",
                    "{what}: its anisotropic roughness is not supported; it is equally rough in both directions",
                    what=source,
                ),
            )
            return {
                "roughness": math.sqrt(math.sqrt(along * across)) if along * across > 0 else math.sqrt(max(along, across) / 2)
            }
        return brushed(along, across)

    def _with_alpha(self, material: Material, alpha: Varying, source: Parameters | None) -> Material:
        if alpha.is_constant:
            opacity = min(max(alpha.value[0], 0.0), 1.0)
            return material if opacity == 1 else replace(material, opacity=opacity, alpha_mode="blend")
        texture = self._textures.with_alpha(material.base_color_texture, alpha)
        if texture is None:
            if source is not None:
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-alpha-mapping-averaged",
                        "Alpha textures that are placed unlike the colour are replaced by their mean",
                    ),
                )
            return replace(material, opacity=min(max(self._textures.mean_value(alpha)[0], 0.0), 1.0), alpha_mode="blend")
        return replace(material, base_color_texture=texture, alpha_mode="blend")


def _diffuse_material(color: Varying) -> Material:
    r, g, b = (min(max(v, 0.0), 1.0) for v in color.value)
    return Material(base_color=(r, g, b), base_color_texture=color.texture)


def our_roughness(roughness: float, power: float) -> float:
    value = min(max(roughness, 0.0), 1.0) ** power
    return 0.0 if value**2 < _SMOOTH else value
