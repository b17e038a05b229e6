"""Materials of a preview mesh: those of the path tracer, reduced to what a viewer shades without tracing paths."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.preview_mesh import NO_TEXTURE, PreviewMaterial
from renderer.scene.description import SceneDescription, Texture, UvTransform
from renderer.scene.material import Material, conductor_reflectance
from renderer.scene.preview_textures import Textures
from renderer.settings import Vec3

__all__ = ["PreviewSurface", "preview_surface"]

_BLACK, _WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
_ROUGHNESS = {"glass": 0.0, "conductor": 0.0, "mirror": 0.0, "hair": 0.55, "diffuse": 1.0}  # unless given
_METALS = ("conductor", "mirror")
_CLOUDY = 0.5  # share of the light that is scattered in an object, above which it is drawn as opaque


class PreviewSurface(NamedTuple):
    """A preview's material, with the base colour and opacity of its vertices, and the UVs that its textures have."""

    material: PreviewMaterial
    color: Vec3
    opacity: float
    uv_set: int
    transform: UvTransform


def preview_surface(material: Material, description: SceneDescription, textures: Textures, size: float) -> PreviewSurface:
    """Returns the preview's surface for a material.

    textures: receives the textures that are shown. size: thickness of the object, over which its inside absorbs light.
    """
    color, f0 = material.base_color, _BLACK
    rough = material.roughness if material.roughness is not None else _ROUGHNESS.get(material.kind, 1.0)
    shown = PreviewMaterial(metallic=float(material.kind in _METALS), roughness=rough, ior=material.ior, thin=material.thin)
    if material.kind == "conductor":
        r, g, b = (float(conductor_reflectance(np.ones(1), e, k)[0]) for e, k in zip(material.eta, material.k, strict=True))
        color = (r, g, b)
    elif material.kind == "blinn_phong":
        f0, rough = material.specular_color, (2 / (material.shininess + 2)) ** 0.25  # Walter et al. 2007
        shown = shown._replace(roughness=rough)
    elif material.kind in ("glass", "plastic", "metallic_roughness"):
        f0 = _dielectric(material)
    if material.kind == "glass":
        shown = shown._replace(transmission=1.0)
    elif material.kind == "metallic_roughness":
        shown = shown._replace(
            metallic=material.metallic,
            transmission=material.transmission,
            coat=material.clearcoat,
            coat_roughness=material.clearcoat_roughness,
        )
    if shown.transmission > 0.0:
        left, scattered = _inside(material, size)
        color = _times(color, left)
        if scattered > _CLOUDY:
            shown = shown._replace(transmission=0.0)
    emits = max(material.emission) > 0.0
    shown = shown._replace(emission=material.emission if emits else _BLACK, unlit=material.kind == "unlit", f0=f0)
    used = _Used(description, textures)
    shown = shown._replace(
        alpha_mode=material.alpha_mode,
        cutoff=material.alpha_cutoff,
        texture=used.number(material.base_color_texture),
        emission_texture=used.number(material.emission_texture) if emits else NO_TEXTURE,
    )
    if material.kind in ("glass", "conductor", "plastic", "metallic_roughness"):
        shown = shown._replace(metallic_roughness_texture=used.number(material.metallic_roughness_texture, is_data=True))
        if shown.metallic_roughness_texture == NO_TEXTURE and material.metallic_roughness_texture is not None:
            rough, metal = textures.mean(material.metallic_roughness_texture)
            shown = shown._replace(roughness=shown.roughness * rough, metallic=shown.metallic * metal)
    return PreviewSurface(shown, color, 1.0 if material.alpha_mode == "opaque" else material.opacity, used.uv_set, used.transform)


class _Used:
    """The textures of a material that have the UVs of the first one: a preview has one set of UVs."""

    def __init__(self, description: SceneDescription, textures: Textures) -> None:
        self._description, self._textures = description, textures
        self._first: Texture | None = None

    @property
    def uv_set(self) -> int:
        return self._first.uv_set if self._first else 0

    @property
    def transform(self) -> UvTransform:
        return self._first.transform if self._first else Texture(0).transform

    def number(self, texture: int | None, is_data: bool = False) -> int:
        """Returns the number of a texture in the preview; NO_TEXTURE if there is none, or if it has other UVs."""
        if texture is None or texture >= len(self._description.textures):
            return NO_TEXTURE
        found = self._description.textures[texture]
        if self._first is not None and (found.uv_set, found.transform) != (self._first.uv_set, self._first.transform):
            return NO_TEXTURE
        self._first = self._first or found
        return self._textures.number(texture, is_data)


def _dielectric(material: Material) -> Vec3:
    """Returns the reflectance at normal incidence: Schlick's, scaled and tinted as KHR_materials_specular does."""
    specular = material.specular if material.kind != "glass" else 1.0
    tint = material.specular_color if material.kind != "glass" else _WHITE
    level = ((material.ior - 1) / (material.ior + 1)) ** 2
    r, g, b = (min(level * c, 1.0) * specular for c in tint)
    return r, g, b


def _inside(material: Material, size: float) -> tuple[Vec3, float]:
    """Returns what is left of light after `size` of the material's inside, and the share of the light that is scattered there."""
    if material.thin:
        return _WHITE, 0.0
    depth = size / material.attenuation_distance if math.isfinite(material.attenuation_distance) else 0.0
    kept = (max(c, 1e-6) ** depth for c in material.attenuation_color)
    r, g, b = (c * math.exp(-min(a * size, 50.0)) for c, a in zip(kept, material.sigma_a, strict=True))
    return (r, g, b), 1.0 - math.exp(-min(max(material.sigma_s) * size, 50.0))


def _times(a: Vec3, b: Vec3) -> Vec3:
    r, g, c = (x * y for x, y in zip(a, b, strict=True))
    return r, g, c
