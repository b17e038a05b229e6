"""KHR_materials_pbrSpecularGlossiness, which Khronos has archived and many models still have.

It becomes a dielectric whose reflectance at normal incidence is the specular colour: an index of refraction that reflects
all, times KHR_materials_specular's colour. Khronos's own advice for moving models on is the same.
"""

from __future__ import annotations

import numpy as np

from renderer.scene.description import Image
from renderer.scene.material import ALL_REFLECTING_IOR, Material
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.textures import Textures
from renderer.scene.readers.numbers import unit, unit_color
from renderer.scene.textures import TextureShelf

__all__ = ["read_specular_glossiness"]

_KEY = "specularGlossinessTexture"


def read_specular_glossiness(source: Json, material: Material, textures: Textures, shelf: TextureShelf) -> None:
    """Sets the fields of a Material by the extension's."""
    r, g, b, material.opacity = (unit(c) for c in source.vector("diffuseFactor", (1.0, 1.0, 1.0, 1.0)))
    material.base_color = (r, g, b)
    material.base_color_texture = textures.find(source, "diffuseTexture", material.name, srgb=True)
    specular = unit_color(source.vector("specularFactor", (1.0, 1.0, 1.0)))
    glossiness = unit(source.number("glossinessFactor", 1.0))
    material.roughness = 1.0 - glossiness
    if _KEY not in source and material.base_color_texture is None and max(r, g, b) < 0.05 and max(specular) > 0.3:
        material.base_color, material.metallic = specular, 1.0
        return
    material.metallic = 0.0
    material.ior, material.specular_color = ALL_REFLECTING_IOR, specular
    material.specular_color_texture = textures.find(source, _KEY, material.name, srgb=True)
    if material.specular_color_texture is not None:
        found = textures.find(source, _KEY, material.name)
        material.metallic_roughness_texture = shelf.derived(found, f"roughness {glossiness}", lambda i: _roughness(i, glossiness))
        material.roughness = 1.0


def _roughness(image: Image, glossiness: float) -> Image:
    """glTF's roughness (G) of glossiness (A)."""
    alpha = image.pixels[..., 3] if image.pixels.shape[2] == 4 else np.full(image.pixels.shape[:2], 255, np.uint8)
    pixels = np.zeros((*alpha.shape, 4), np.uint8)
    pixels[..., 1] = np.rint(255 - alpha * np.float32(glossiness))
    pixels[..., 3] = 255
    return Image(f"{image.name} as roughness", pixels, srgb=False)
