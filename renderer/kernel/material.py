"""What a surface is made of, and the one place where the models are told apart.

To add a model: a file in bsdf/, a number here, a branch in each of `eval_material` and `sample_material`, and its name in
renderer/scene/description.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import eval_and_pdf_metallic_roughness, sample_metallic_roughness
from renderer.kernel.bsdf.mirror import sample_mirror
from renderer.kernel.texture import lookup

__all__ = [
    "DIFFUSE",
    "GLASS",
    "METALLIC_ROUGHNESS",
    "MIRROR",
    "Material",
    "emission",
    "eval_material",
    "fetch_material",
    "sample_material",
]

DIFFUSE, MIRROR, GLASS, METALLIC_ROUGHNESS = 0, 1, 2, 3

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)


class Material(NamedTuple):
    """A material at a point, its textures looked up. float32, but for the kind."""

    kind: int
    base: tuple[float, float, float]
    metallic: float
    roughness: float
    ior: float


@device
def fetch_material(scene, surface):
    """The material of a surface, at the point hit."""
    number, uv = surface.material, surface.uv
    row = scene.material
    textures = scene.material_texture
    base = (row[number, 0], row[number, 1], row[number, 2])
    metallic = row[number, 6]
    roughness = row[number, 7]
    if textures[number, 0] >= 0:
        base = vec.mul(base, lookup(scene.texture, scene.texel, textures[number, 0], uv[0], uv[1]))
    if textures[number, 2] >= 0:
        _, green, blue = lookup(scene.texture, scene.texel, textures[number, 2], uv[0], uv[1])
        roughness *= green
        metallic *= blue
    return Material(scene.material_kind[number], base, metallic, roughness, row[number, 8])


@device
def emission(scene, number, uv, front):
    """The radiance that leaves the given side of material `number` at uv."""
    row = scene.material
    if not (front or row[number, 9] != _ZERO):
        return _BLACK
    radiance = (row[number, 3], row[number, 4], row[number, 5])
    if scene.material_texture[number, 1] >= 0:
        radiance = vec.mul(radiance, lookup(scene.texture, scene.texel, scene.material_texture[number, 1], uv[0], uv[1]))
    return radiance


@device
def is_specular(material):
    """Whether it scatters into single directions only, which light sampling cannot find."""
    return material.kind == MIRROR or material.kind == GLASS


@device
def eval_material(material, wo, wi):
    """(f |cos|, pdf) of a pair of local directions."""
    if material.kind == METALLIC_ROUGHNESS:
        return eval_and_pdf_metallic_roughness(material.base, material.metallic, material.roughness, wo, wi)
    if material.kind == DIFFUSE:
        return eval_diffuse(material.base, wo, wi), pdf_diffuse(wo, wi)
    return _BLACK, _ZERO


@device
def sample_material(material, front, wo, choose, u):
    """A local direction: (wi, weight, pdf, radiance scale). pdf is 0 for specular models; the scale is 1 but in refraction.

    front: whether wo is on the side that the geometric normal points to. The scale is the eta**2 by which refraction
    thinned the radiance; Russian roulette undoes it.
    """
    if material.kind == DIFFUSE:
        wi, weight, pdf = sample_diffuse(material.base, wo, u)
        return wi, weight, pdf, _ONE
    if material.kind == METALLIC_ROUGHNESS:
        wi, weight, pdf = sample_metallic_roughness(material.base, material.metallic, material.roughness, wo, choose, u)
        return wi, weight, pdf, _ONE
    if material.kind == MIRROR:
        wi, weight = sample_mirror(material.base, wo)
        return wi, weight, _ZERO, _ONE
    eta = material.ior if front else _ONE / material.ior
    wi, weight, transmitted = sample_glass(material.base, eta, wo, choose)
    return wi, weight, _ZERO, eta * eta if transmitted else _ONE
