"""KHR_materials_pbrSpecularGlossiness, which Khronos has archived, but many models use.

It becomes a dielectric whose reflectance at normal incidence is the specular colour: its index of refraction is so high that it
reflects all light, and the colour of KHR_materials_specular scales that. Khronos recommends this for converting models.
"""

from __future__ import annotations

import numpy as np

from renderer.scene.description import Image
from renderer.scene.material import ALL_REFLECTING_IOR, Material
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.textures import Textures
from renderer.scene.readers.linear_images import alpha, encoded
from renderer.scene.readers.number_ranges import unit, unit_color
from renderer.scene.textures import TextureShelf

__all__ = ["read_specular_glossiness"]

_KEY = "specularGlossinessTexture"


def read_specular_glossiness(source: Json, material: Material, textures: Textures, shelf: TextureShelf) -> None:
    """Sets the material's fields from KHR_materials_pbrSpecularGlossiness."""
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
        material.metallic_roughness_texture = shelf.derived_texture(
            found, f"roughness {glossiness}", lambda i: _roughness(i, glossiness)
        )
        material.roughness = 1.0


def _roughness(image: Image, glossiness: float) -> Image:
    """Returns a roughness texture (channel G, as in glTF) from a glossiness texture (channel A)."""
    rough = 1 - alpha(image) * np.float32(glossiness)
    black = np.zeros_like(rough)
    values = np.dstack([black, rough, black, np.ones_like(rough)])
    return Image(f"{image.name} as roughness", encoded(values, image), srgb=False)
