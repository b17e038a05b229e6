"""Converts FBX materials: Lambert and Phong as published, physically based ones by ufbx's common parameters.

ufbx maps the materials of 3ds Max, Arnold, Maya, OpenPBR, glTF and Blender to these parameters.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from renderer.scene.description import Vec3
from renderer.scene.material import ALL_REFLECTING_IOR, MOST_DENSE, MOST_FORWARD, Material
from renderer.scene.readers.coats import tint_beneath
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import each, text
from renderer.scene.readers.fbx.textures import Pictures
from renderer.scene.readers.linear_images import alpha
from renderer.scene.readers.mtl_maps import as_alpha, holds_normals, inverted, with_opacity, with_roughness_and_metal
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.readers.scattering import attenuating_medium
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Materials"]

_UNKNOWN, _LAMBERT, _PHONG = 0, 1, 2
_BLENDER, _PLASTIC = 11, 0.25
_ABBE_SHADER_TYPES = (3, 4, 9)  # ufbx_shader_type: OSL's and Arnold's standard surface, and OpenPBR, store an Abbe number
_MAX_RADIANCE = 1e9
_MOST_SCATTER = 1e6
_LEFT_OUT = {
    "displacement_map": Sentence("texture-use-displacement", "displacement"),
    "diffuse_roughness": Sentence("fbx-material-diffuse-roughness", "diffuse roughness"),
    "transmission_extra_roughness": Sentence("fbx-material-transmission-roughness", "extra transmission roughness"),
    "matte_factor": Sentence("fbx-material-matte", "matte factor"),
}
_PBR = {name: i for i, name in enumerate(layout.PBR_MAPS)}
_FBX = {name: i for i, name in enumerate(layout.FBX_MAPS)}
_FEATURES = {name: 2 * i for i, name in enumerate(layout.FEATURES)}


class Materials:
    """Converts materials of the file to materials of the description, each once. unit: metres per unit of the file."""

    def __init__(self, pictures: Pictures, shelf: TextureShelf, materials: list[Material], unit: float) -> None:
        self._pictures, self._shelf, self._materials, self._unit = pictures, shelf, materials, unit
        self._known: dict[int, int] = {}
        self.guessed: Counter[str] = Counter()  # counts of assumptions and omissions, by sentence

    def number(self, source: Any | None) -> int:
        """Returns the index, in the scene description, of an FBX material. source: None for surfaces without a material."""
        key = -1 if source is None else int(source.element_id)
        if key not in self._known:
            self._materials.append(Material() if source is None else self._read(source))
            self._known[key] = len(self._materials) - 1
        return self._known[key]

    def _read(self, source: Any) -> Material:
        name = text(source.name) or "material"
        said = _MaterialValues(source, name, self._pictures)
        material = Material(name, "metallic_roughness", (1.0, 1.0, 1.0), metallic=0.0, roughness=0.5)
        material.base_color = said.color("base_color", "base_factor", (0.8, 0.8, 0.8))
        material.base_color_texture = said.texture("base_color", srgb=True)
        if material.base_color_texture is not None:
            # A texture replaces the colour; the factor still applies.
            factor = unit(said.value("base_factor", 1.0))
            material.base_color = (factor, factor, factor)
        self._emission(said, material)
        self._normals(said, material)
        if source.shader in (_UNKNOWN, _LAMBERT):
            material.kind, material.roughness = "diffuse", None
        elif source.shader == _PHONG:
            self._phong(said, material)
        else:
            self._physical(said, material)
        self._opacity(said, material)
        if said.feature("unlit"):
            material.kind, material.roughness, material.emission, material.emission_texture = "unlit", None, (0.0, 0.0, 0.0), None
        left: list[str] = [words for key, words in _LEFT_OUT.items() if said.has_value(key)]
        left += [Sentence("texture-of-property", "the texture of {property}", property=name) for name in said.unread_properties()]
        if left:
            self._shelf.warn_of_surface(
                Sentence(
                    "material-parts-dropped", "Material {name}: not supported and left out: {parts}.", name=name, parts=[*left]
                )
            )
        return material

    def _emission(self, values: _MaterialValues, material: Material) -> None:
        material.emission = values.color("emission_color", "emission_factor", (0.0, 0.0, 0.0), _MAX_RADIANCE)
        material.double_sided = True  # surfaces are two-sided in FBX and in the programs that write it
        texture = values.texture("emission_color", srgb=True)
        factor = values.value("emission_factor", 1.0)
        if texture is not None and factor > 0:
            material.emission_texture = texture
            level = clamped(factor, 0.0, _MAX_RADIANCE)
            material.emission = (level, level, level)

    def _normals(self, values: _MaterialValues, material: Material) -> None:
        material.normal_texture = values.texture("normal_map")
        if material.normal_texture is None:
            texture = values.fbx_texture("bump")
            if texture is not None and holds_normals(self._shelf.image_of(texture)):
                material.normal_texture = texture
                self.guessed[Sentence("fbx-bump-read-as-normal", "bump maps of mostly blue pixels, read as normal maps")] += 1
            elif texture is not None:
                self._shelf.warn_of_surface(
                    Sentence(
                        "material-bump-heights-dropped",
                        "Material {name}: its bump map contains heights and is left out; bake it to a normal map.",
                        name=material.name,
                    )
                )

    def _opacity(self, values: _MaterialValues, material: Material) -> None:
        is_old = values.source.shader in (_UNKNOWN, _LAMBERT, _PHONG)
        opacity = 1 - max(values.fbx_color("transparency_color", "transparency_factor")) if is_old else values.opacity()
        if opacity < 1 and not (is_old and opacity == 0):  # some exporters write 0 for opaque
            material.opacity, material.alpha_mode = opacity, "blend"
        elif opacity < 1:
            self.guessed[Sentence("fbx-opacity-zero", "materials of opacity 0, read as opaque")] += 1
        mask = values.fbx_texture("transparency_color") if is_old else values.texture("opacity")
        if mask is None:
            return
        if material.transmission > 0:
            self.guessed[Sentence("fbx-opacity-on-transmission", "opacity maps on materials that transmit light")] += 1
            return
        if is_old and (alpha(self._shelf.image_of(mask)) == 1).all():
            self._shelf.warn_of_surface(
                Sentence(
                    "fbx-transparency-map-without-alpha",
                    "Material {name}: its transparency map has no alpha and is left out.",
                    name=material.name,
                )
            )
            return
        same = mask == material.base_color_texture
        material.base_color_texture = mask if same else with_opacity(self._shelf, material.base_color_texture, mask)
        material.alpha_mode = "blend"

    def _physical(self, values: _MaterialValues, material: Material) -> None:
        rough, metal = values.texture("roughness"), values.texture("metalness")
        if rough is None:
            rough = inverted(self._shelf, values.texture("glossiness"))
        material.metallic_roughness_texture = with_roughness_and_metal(self._shelf, rough, metal)
        material.roughness = 1.0 if rough is not None else values.roughness("", 0.5)
        material.metallic = 1.0 if metal is not None else unit(values.value("metalness", 0.0))
        material.ior = clamped(values.value("specular_ior", 1.5), 1.0, ALL_REFLECTING_IOR)
        material.specular_texture = as_alpha(self._shelf, values.texture("specular_factor"))
        material.specular = 1.0 if material.specular_texture is not None else unit(values.value("specular_factor", 1.0))
        if values.source.shader == _BLENDER:
            # Blender's exporter writes 0.25 for a reflectance of 4 %; ufbx does not convert that.
            level = values.fbx_value("specular_factor", _PLASTIC) if material.specular_texture is None else _PLASTIC
            material.specular = unit(level / _PLASTIC)
        material.specular_color_texture = values.texture("specular_color", srgb=True)
        if material.specular_color_texture is None:
            material.specular_color = values.color("specular_color", None, (1.0, 1.0, 1.0))
        material.anisotropy = unit(values.value("specular_anisotropy", 0.0))
        material.anisotropy_rotation = math.remainder(2 * math.pi * values.value("specular_rotation", 0.0), 2 * math.pi)
        material.transmission_texture = values.texture("transmission_factor")
        material.transmission = (
            1.0 if material.transmission_texture is not None else unit(values.value("transmission_factor", 0.0))
        )
        if material.transmission > 0:
            material.thin = values.feature("thin_walled")
            tint = values.color("transmission_color", None, (1.0, 1.0, 1.0))
            depth = values.value("transmission_depth", 0.0)
            if depth > 0 and not material.thin:
                self._fill(values, material, tint, depth * self._unit)
                material.base_color = (1.0, 1.0, 1.0)
            else:
                material.base_color = tint
            dispersion = values.value("transmission_dispersion", 0.0)
            if dispersion > 0 and values.source.shader in _ABBE_SHADER_TYPES:
                dispersion = 20 / dispersion
            material.dispersion = clamped(dispersion, 0.0, 20.0)
        self._subsurface(values, material)
        self._coat(values, material)
        if values.value("sheen_factor", 0.0) > 0:
            material.sheen_color = values.color("sheen_color", "sheen_factor", (0.0, 0.0, 0.0))
            material.sheen_color_texture = values.texture("sheen_color", srgb=True)
            if material.sheen_color_texture is not None:
                level = unit(values.value("sheen_factor", 1.0))
                material.sheen_color = (level, level, level)
            material.sheen_roughness = unit(values.value("sheen_roughness", 0.3))
        film = values.value("thin_film_factor", 1.0)  # Arnold's has only a thickness
        if film > 0 and values.value("thin_film_thickness", 0.0) > 0:
            thickness = clamped(values.value("thin_film_thickness", 0.0), 0.0, 1e5)
            material.iridescence = unit(film)
            material.iridescence_thickness = (thickness, thickness)
            material.iridescence_ior = clamped(values.value("thin_film_ior", 1.4), 1.0, 5.0)

    def _fill(self, values: _MaterialValues, material: Material, tint: Vec3, depth: float) -> None:
        """Sets the medium inside glass. tint: transmittance over `depth` metres."""
        scatter = values.color("transmission_scatter", None, (0.0, 0.0, 0.0), _MOST_SCATTER)
        if max(scatter) <= 0:
            material.attenuation_color, material.attenuation_distance = tint, depth
            return
        found = attenuating_medium(tint, depth, scatter, values.value("transmission_scatter_anisotropy", 0.0))
        material.sigma_a, material.sigma_s, material.g = found.sigma_a, found.sigma_s, found.g

    def _subsurface(self, values: _MaterialValues, material: Material) -> None:
        """Sets the subsurface scattering, and mixes its colour into the base colour, since a material has one colour for both."""
        share = unit(values.value("subsurface_factor", 0.0))
        if share <= 0 or values.feature("thin_walled"):
            return
        color = values.color("subsurface_color", None, (1.0, 1.0, 1.0))
        texture = values.texture("subsurface_color", srgb=True)
        if material.base_color_texture is None and texture is None:
            pairs = zip(material.base_color, color, strict=True)
            material.base_color = unit_color((1 - share) * a + share * b for a, b in pairs)
        elif share >= 0.5 and texture is not None:
            material.base_color, material.base_color_texture = (1.0, 1.0, 1.0), texture
        scale = values.value("subsurface_scale", 1.0) * self._unit
        radius = values.color("subsurface_radius", None, (1.0, 1.0, 1.0), MOST_DENSE)
        material.subsurface = share
        material.subsurface_radius = unit_color((scale * c for c in radius), MOST_DENSE)
        material.subsurface_anisotropy = clamped(values.value("subsurface_anisotropy", 0.0), -MOST_FORWARD, MOST_FORWARD)

    def _coat(self, values: _MaterialValues, material: Material) -> None:
        material.clearcoat_texture = values.texture("coat_factor")
        material.clearcoat = 1.0 if material.clearcoat_texture is not None else unit(values.value("coat_factor", 0.0))
        if material.clearcoat > 0:
            material.clearcoat_roughness_texture = values.texture("coat_roughness")
            rough = material.clearcoat_roughness_texture is not None
            material.clearcoat_roughness = 1.0 if rough else values.roughness("coat_", 0.0)
            material.clearcoat_normal_texture = values.texture("coat_normal")
            tint_beneath(material, values.color("coat_color", None, (1.0, 1.0, 1.0)))

    def _phong(self, values: _MaterialValues, material: Material) -> None:
        specular = values.fbx_color("specular_color", "specular_factor")
        exponent = max(values.fbx_value("specular_exponent", 20.0), 0.0)
        level = unit(values.fbx_value("specular_factor", 1.0))
        texture = values.fbx_texture("specular_color", srgb=True) if level > 0 else None
        if texture is None and max(specular) == 0:
            material.kind, material.roughness = "diffuse", None
            return
        # Phong's exponent to GGX roughness: alpha^2 = 2 / (n + 2), roughness = sqrt(alpha).
        # Source: Walter et al. 2007, Karis 2013.
        material.roughness = unit((2 / (exponent + 2)) ** 0.25)
        material.specular_color = unit_color(specular) if texture is None else (level, level, level)
        material.specular_color_texture = texture
        material.specular_texture = as_alpha(self._shelf, values.fbx_texture("specular_factor"))


class _MaterialValues:
    """The properties of one FBX material. Records which of the material's textures were read."""

    def __init__(self, source: Any, name: str, pictures: Pictures) -> None:
        self.source, self._name, self._pictures = source, name, pictures
        self._read: set[int] = set()  # textures, by address

    def feature(self, name: str) -> bool:
        return bool(self.source.features[_FEATURES[name]])

    def has_value(self, name: str) -> bool:
        """Returns True if the material property `name` has a texture or a value other than 0."""
        found = self.source.pbr[_PBR[name]]
        return bool(found.texture and found.texture_enabled) or bool(found.has_value and any(list(found.value)[:3]))

    def value(self, name: str, default: float) -> float:
        found = self.source.pbr[_PBR[name]]
        value = float(found.value[0]) if found.has_value else default
        return value if math.isfinite(value) else default

    def fbx_value(self, name: str, default: float) -> float:
        found = self.source.fbx[_FBX[name]]
        value = float(found.value[0]) if found.has_value else default
        return value if math.isfinite(value) else default

    def roughness(self, layer: str, default: float) -> float:
        """Returns the roughness of the surface, or of a layer such as `coat_`; converts it if the file stores glossiness."""
        gloss = f"{layer}glossiness"
        if self.feature(f"{layer}roughness_as_glossiness") and self.source.pbr[_PBR[gloss]].has_value:
            return unit(1 - self.value(gloss, 1 - default))
        return unit(self.value(f"{layer}roughness", default))

    def color(self, name: str, factor: str | None, default: Vec3, high: float = 1.0) -> Vec3:
        found = self.source.pbr[_PBR[name]]
        scale = 1.0 if factor is None else self.value(factor, 1.0)
        return _scaled(found, default, scale, high)

    def fbx_color(self, name: str, factor: str) -> Vec3:
        return _scaled(self.source.fbx[_FBX[name]], (0.0, 0.0, 0.0), self.fbx_value(factor, 1.0), 1.0)

    def texture(self, name: str, srgb: bool = False) -> int | None:
        return self._find(self.source.pbr[_PBR[name]], srgb)

    def fbx_texture(self, name: str, srgb: bool = False) -> int | None:
        return self._find(self.source.fbx[_FBX[name]], srgb)

    def _find(self, found: Any, srgb: bool) -> int | None:
        self._read.add(int(found.texture or 0))
        return (
            self._pictures.find(found.texture, Sentence("label-material", "Material {name}", name=self._name), srgb)
            if found.texture_enabled
            else None
        )

    def unread_properties(self) -> list[str]:
        """Returns the properties whose textures were not read, except ambient occlusion and those with their own note."""
        silent = [self.source.pbr[_PBR[name]].texture for name in (*_LEFT_OUT, "ambient_occlusion")]
        silent += [self.source.fbx[_FBX[name]].texture for name in ("displacement", "ambient_color", "ambient_factor")]
        known = self._read | {int(texture or 0) for texture in silent}
        left = [entry for entry in each(self.source.textures, layout.MaterialTexture) if int(entry.texture or 0) not in known]
        return list(dict.fromkeys(text(entry.property).rsplit("|", 1)[-1] for entry in left))

    def opacity(self) -> float:
        found = self.source.pbr[_PBR["opacity"]]
        if not found.has_value:
            return 1.0
        values = [float(v) for v in found.value[: max(min(found.components, 3), 1)]]
        mean = float(np.mean(values))
        return unit(mean) if math.isfinite(mean) else 1.0


def _scaled(found: Any, default: Vec3, scale: float, high: float) -> Vec3:
    values = [float(v) for v in found.value[:3]] if found.has_value else list(default)
    if found.has_value and found.components == 1:
        values = values[:1] * 3
    r, g, b = (clamped(v * scale, 0.0, high) if math.isfinite(v * scale) else d for v, d in zip(values, default, strict=True))
    return r, g, b
