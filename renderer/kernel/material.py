"""What a surface is made of, and the one place where the models are told apart.

To add a model: a file in bsdf/, a number in rows.py, a branch in each of `eval_material` and `sample_material`, and its name
in renderer/scene/description.py and packing.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import rows
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import eval_and_pdf_metallic_roughness, sample_metallic_roughness
from renderer.kernel.bsdf.mirror import sample_mirror
from renderer.kernel.rows import DIFFUSE, GLASS, METALLIC_ROUGHNESS, MIRROR
from renderer.kernel.texture import sample_texture

__all__ = [
    "LAYER_SLOTS",
    "Material",
    "absorption",
    "emission",
    "eval_material",
    "fetch_material",
    "is_specular",
    "is_transparent",
    "opacity",
    "sample_material",
]

LAYER_SLOTS = rows.COLUMNS  # floats that `fetch_material` needs to write to

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)


class Material(NamedTuple):
    """A material at a point, its textures looked up. float32, but for the kind."""

    kind: int
    base: tuple[float, float, float]
    metallic: float
    roughness: float
    f0: tuple[float, float, float]  # of the dielectric, facing,
    f90: float  # and grazing
    eta: float  # index of refraction beyond the surface over the one on the viewer's side
    layers: Any  # (LAYER_SLOTS,), of the rarer kinds; else not filled


@device
def _rgb(row, number, column):
    return row[number, column], row[number, column + 1], row[number, column + 2]


@device
def fetch_material(scene, surface, frame, layers):
    """The material of a surface, at the point hit.

    frame: from `shading_frame`; layers: (LAYER_SLOTS,) float32 to write to, which the Material then refers to.
    """
    number = surface.material
    row = scene.material
    textures = scene.material_texture
    kind = scene.material_kind[number]
    base = _rgb(row, number, rows.BASE)
    metallic = row[number, rows.METALLIC]
    roughness = row[number, rows.ROUGHNESS]
    ior = row[number, rows.IOR]
    if scene.material_flags[number] & rows.TEXTURED != 0:
        if textures[number, rows.BASE_TEXTURE] >= 0:
            r, g, b, _ = sample_texture(scene, textures[number, rows.BASE_TEXTURE], surface.uv, surface.uv1)
            base = (base[0] * r, base[1] * g, base[2] * b)
        if textures[number, rows.METALLIC_ROUGHNESS_TEXTURE] >= 0:
            _, g, b, _ = sample_texture(scene, textures[number, rows.METALLIC_ROUGHNESS_TEXTURE], surface.uv, surface.uv1)
            roughness *= g
            metallic *= b
    base = (base[0] * surface.color[0], base[1] * surface.color[1], base[2] * surface.color[2])
    f90 = row[number, rows.SPECULAR]
    f0 = (row[number, rows.F0] * f90, row[number, rows.F0 + 1] * f90, row[number, rows.F0 + 2] * f90)
    return Material(kind, base, metallic, roughness, f0, f90, ior if surface.front else _ONE / ior, layers)


@device
def is_transparent(scene, number):
    """Whether `opacity` may be below 1 somewhere on material `number`."""
    return scene.material_flags[number] & rows.TRANSPARENT != 0


@device
def opacity(scene, number, uv, uv1, vertex_alpha):
    """The chance, 0 ... 1, that light meets material `number` there rather than pass as if it were not."""
    flags = scene.material_flags[number]
    if flags & rows.TRANSPARENT == 0:
        return _ONE
    alpha = scene.material[number, rows.OPACITY] * vertex_alpha
    texture = scene.material_texture[number, rows.BASE_TEXTURE]
    if texture >= 0:
        alpha *= sample_texture(scene, texture, uv, uv1)[3]
    if flags & rows.MASKED != 0:
        return _ONE if alpha >= scene.material[number, rows.ALPHA_CUTOFF] else _ZERO
    return min(max(alpha, _ZERO), _ONE)


@device
def absorption(scene, number):
    """What the inside of material `number` takes from light: per unit length, rgb; (0, 0, 0) where it has no inside."""
    if scene.material_flags[number] & rows.ABSORBING == 0:
        return _BLACK
    return _rgb(scene.material, number, rows.ABSORPTION)


@device
def emission(scene, number, uv, uv1, front):
    """The radiance that leaves the given side of material `number` at these texture coordinates."""
    row = scene.material
    if not (front or row[number, rows.DOUBLE_SIDED] != _ZERO):
        return _BLACK
    radiance = _rgb(row, number, rows.EMISSION)
    texture = scene.material_texture[number, rows.EMISSION_TEXTURE]
    if texture >= 0:
        r, g, b, _ = sample_texture(scene, texture, uv, uv1)
        radiance = (radiance[0] * r, radiance[1] * g, radiance[2] * b)
    return radiance


@device
def is_specular(material):
    """Whether it scatters into single directions only, which light sampling cannot find."""
    return material.kind == MIRROR or material.kind == GLASS


@device
def eval_material(material, wo, wi):
    """(f |cos|, pdf) of a pair of local directions."""
    if material.kind == METALLIC_ROUGHNESS:
        return eval_and_pdf_metallic_roughness(
            material.base, material.metallic, material.roughness, material.f0, material.f90, wo, wi
        )
    if material.kind == DIFFUSE:
        return eval_diffuse(material.base, wo, wi), pdf_diffuse(wo, wi)
    return _BLACK, _ZERO


@device
def sample_material(material, wo, choose, u):
    """A local direction: (wi, weight, pdf, radiance scale). pdf is 0 where a single direction was taken; scale is 1 but in
    refraction: the eta**2 by which it thinned the radiance; Russian roulette undoes it.
    """
    if material.kind == DIFFUSE:
        wi, weight, pdf = sample_diffuse(material.base, wo, u)
        return wi, weight, pdf, _ONE
    if material.kind == METALLIC_ROUGHNESS:
        wi, weight, pdf = sample_metallic_roughness(
            material.base, material.metallic, material.roughness, material.f0, material.f90, wo, choose, u
        )
        return wi, weight, pdf, _ONE
    if material.kind == MIRROR:
        wi, weight = sample_mirror(material.base, wo)
        return wi, weight, _ZERO, _ONE
    wi, weight, transmitted = sample_glass(material.base, material.eta, wo, choose)
    return wi, weight, _ZERO, material.eta * material.eta if transmitted else _ONE
