"""Material evaluation: texture lookups, and the only module that dispatches to the BSDF models.

To add a model: a file in bsdf/, its `Kind` in renderer/arrays/rows.py, its parameters in renderer/scene/material.py, and a
branch in `eval_material` and `sample_material`, or in rare_materials.py. A model that is evaluated for eight paths at a time also
needs a list in renderer/kernel/backends/cpu/surfaces.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import (
    COAT_NORMAL,
    COLUMNS,
    CONDUCTOR,
    DIFFUSE,
    GLASS,
    HAS_BECKMANN,
    HAS_NONLINEAR,
    LAYER_SLOTS,
    LAYERED,
    METALLIC_ROUGHNESS,
    MIRROR,
    SLOTS,
    UNLIT,
)
from renderer.arrays.scene_features import SceneFeatures
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import (
    eval_and_pdf_metallic_roughness,
    eval_base_of_metallic_roughness,
    sample_metallic_roughness,
)
from renderer.kernel.bsdf.mirror import sample_mirror
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.fetch import columns
from renderer.kernel.material.layers import Textures, resolve
from renderer.kernel.material.normal_map import coat_normal
from renderer.kernel.material.rare_materials import eval_diffuse_rare, eval_rare, sample_rare
from renderer.kernel.material.texture import sample_texture
from renderer.kernel.spectrum.indices import dispersed_index
from renderer.kernel.spectrum.upsampling import reflectance_at
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, lookup, u32, where, where3

__all__ = [
    "LAYER_SLOTS",
    "UNLIT",
    "Material",
    "Parameters",
    "colored_index",
    "dielectric_reflectance",
    "emission",
    "eval_diffuse_lobes",
    "eval_material",
    "factors_at",
    "fetch_material",
    "has_flag",
    "hero_index",
    "is_specular",
    "look_up_layers",
    "material_of",
    "material_with",
    "opacity",
    "parameters_at",
    "relative_index",
    "sample_material",
    "texture_factors",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_NONE = np.uint32(0)
_TRANSPARENT = np.uint32(rows.TRANSPARENT)
_NO_TEXTURE = np.uint32(2**32 - 1)
_MATCHED = np.float32(5e-3)  # indices of refraction closer to 1 than this do not refract
_DISPERSION_SPREAD = np.float32(0.025)  # spread of the index over the channels, KHR_materials_dispersion


class Material(NamedTuple):
    """A material at a surface point, after its textures were looked up. Fields are float32, except the kind."""

    kind: int
    base: tuple[float, float, float]
    metallic: float
    roughness: float
    f0: tuple[float, float, float]  # of the dielectric at normal incidence,
    f90: float  # and at grazing incidence
    eta: float  # index of refraction beyond the surface over the one on the viewer's side
    two_sided: bool
    layers: Any  # (LAYER_SLOTS,) for kinds from CONDUCTOR on; else not filled
    has: SceneFeatures  # of its scene


@device
def _rgb(table, number, column):
    return columns(table, number, COLUMNS, column, 3)


@device
def _value(table, number, column):
    return columns(table, number, COLUMNS, column, 1)[0]


@device
def _texture(scene, number, slot):
    return columns(scene.material_texture, number, SLOTS, slot, 1)[0]


@device
def has_flag(scene, number, flag):
    """Returns True if material `number` has a flag of renderer/arrays/rows.py. flag: uint32."""
    return (u32(lookup(scene.material_flags, number)) & flag) != _NONE


@device
def texture_factors(scene, number, uv, uv1, time):
    """Returns the factors from the textures of material `number`: (colour, metallic, roughness).

    time, in this module: shutter time, 0 ... 1; None for a scene without motion.
    """
    color, metallic, roughness = (_ONE, _ONE, _ONE), _ONE, _ONE
    texture = _texture(scene, number, rows.BASE_TEXTURE)
    if texture >= 0:
        r, g, b, _ = sample_texture(scene, texture, uv, uv1, time)
        color = r, g, b
    texture = _texture(scene, number, rows.METALLIC_ROUGHNESS_TEXTURE)
    if texture >= 0:
        _, roughness, metallic, _ = sample_texture(scene, texture, uv, uv1, time)
    return color, metallic, roughness


@device
def factors_at(scene, surface, time):
    """Returns the factors from the textures of one surface's material: (colour, metallic, roughness); 1 without textures."""
    factors = (_ONE, _ONE, _ONE), _ONE, _ONE
    if scene.has.textures is not None and scene.material_flags[surface.material] & rows.TEXTURED != 0:
        factors = texture_factors(scene, surface.material, surface.uv, surface.uv1, time)
    return factors


class Parameters(NamedTuple):
    """The parameters that all kinds of materials have, looked up at surface points; for one path or for eight lanes."""

    base: Any  # rgb
    metallic: Any
    roughness: Any
    ior: Any


@device
def parameters_at(scene, surface, factors):
    """Returns the Parameters at surfaces. factors: from the materials' textures, 1 where a material has none."""
    base = _rgb(scene.material, surface.material, rows.BASE)
    metallic, roughness, ior = columns(scene.material, surface.material, COLUMNS, rows.METALLIC, 3)
    if scene.has.textures is not None:
        color, of_metallic, of_roughness = factors
        base = vec.mul(vec.mul(base, color), (surface.color[0], surface.color[1], surface.color[2]))
        metallic, roughness = metallic * of_metallic, roughness * of_roughness
    return Parameters(base, metallic, roughness, ior)


@device
def relative_index(ior, front):
    """Returns the relative index of refraction: the index beyond the surface over that on the viewer's side.

    ior: of the material. front: whether the viewer is on the front side.
    """
    return where(front, ior, _ONE / ior)


@device
def dielectric_reflectance(scene, number, wavelengths):
    """Returns the reflectance of dielectric material `number`: (at normal incidence, rgb; at grazing incidence, a number).

    wavelengths, in this module: those of the path, at which colours are then looked up (kernel/spectrum); None in RGB.
    """
    grazing = _value(scene.material, number, rows.SPECULAR)
    return vec.scale(reflectance_at(scene, _rgb(scene.material, number, rows.F0), wavelengths), grazing), grazing


@device
def material_of(scene, surface, parameters, frame, layers, time, wavelengths=None):
    """Returns the Material of one surface from its Parameters.

    frame: from `shading_frame`. layers: (LAYER_SLOTS,) float32, which is filled here and referenced by the Material.
    """
    base, metallic, roughness, ior = parameters
    kind, eta = scene.material_kind[surface.material], relative_index(ior, surface.front)
    return material_with(scene, surface, kind, base, metallic, roughness, eta, frame, layers, time, wavelengths)


@device
def material_with(scene, surface, kind, base, metallic, roughness, eta, frame, layers, time, wavelengths):
    """Returns the Material of one surface from its kind and parameters; otherwise as `material_of`. eta: as in Material."""
    number = surface.material
    f0, f90 = dielectric_reflectance(scene, number, wavelengths)
    if kind >= CONDUCTOR:
        seen = surface.shading, surface.uv, surface.uv1
        look_up_layers(scene, number, base, metallic, roughness, *seen, frame, layers, time, wavelengths)
    two_sided = scene.material_flags[number] & rows.TRANSMITS != 0
    return Material(kind, base, metallic, roughness, f0, f90, eta, two_sided, layers, scene.has)


@device
def fetch_material(scene, surface, frame, layers, time):
    """Returns the Material of one surface, with its textures looked up; see `material_of`."""
    return material_of(scene, surface, parameters_at(scene, surface, factors_at(scene, surface, time)), frame, layers, time)


@device
def look_up_layers(scene, number, base, metallic, roughness, shading, uv, uv1, frame, layers, time, wavelengths=None):
    """Fills `layers`, (LAYER_SLOTS,) float32, with the looked-up parameters of a material of kind CONDUCTOR or above.

    base, metallic, roughness: already looked up. shading: the shading normal. frame: from `shading_frame`.
    """
    kind, flags = scene.material_kind[number], scene.material_flags[number]
    pane = flags & rows.THIN != 0 or abs(_value(scene.material, number, rows.IOR) - _ONE) < _MATCHED
    arrays = scene.has, scene.material_texture, scene.texture, scene.texture_transform, scene.texel
    textures = Textures(*arrays, number, uv, uv1, scene.key_texture, time, scene.spectrum, wavelengths)
    resolve(kind, scene.material, textures, base, metallic, roughness, pane, layers)
    if scene.has.layers is not None:
        layers[HAS_BECKMANN] = _ONE if flags & rows.BECKMANN != 0 else _ZERO
        layers[HAS_NONLINEAR] = _ONE if flags & rows.NONLINEAR != 0 else _ZERO
    coated = kind == LAYERED and layers[rows.CLEARCOAT] > _ZERO and flags & rows.NEEDS_TANGENT != 0
    if scene.has.layers is not None and coated:
        normal = coat_normal(scene, number, shading, uv, uv1, frame, time)
        layers[COAT_NORMAL], layers[COAT_NORMAL + 1], layers[COAT_NORMAL + 2] = normal


@subroutine
def _channel(throughput, u):
    """Chooses one colour channel by u, with probability in proportion to the throughput.

    Returns (channel, weight that compensates for the other two).
    """
    total = throughput[0] + throughput[1] + throughput[2]
    at = u * total
    if at < throughput[0]:
        return 0, total / throughput[0]
    if at < throughput[0] + throughput[1] or throughput[2] == _ZERO:
        return 1, total / throughput[1]
    return 2, total / throughput[2]


@device
def colored_index(scene, number, throughput, u):
    """Chooses a colour channel for dispersive material `number`: (index of refraction, throughput of that channel only).

    The channel is chosen by u in proportion to the throughput. Channels at 0 are never chosen, so a path keeps its channel at
    later surfaces.
    """
    channel, weight = _channel(throughput, u)
    ior = scene.material[number, rows.IOR]
    ior += (ior - _ONE) * _DISPERSION_SPREAD * scene.material[number, rows.DISPERSION] * np.float32(channel - 1)
    red, green, blue = throughput
    return ior, (
        red * weight if channel == 0 else _ZERO,
        green * weight if channel == 1 else _ZERO,
        blue * weight if channel == 2 else _ZERO,
    )


@device
def hero_index(scene, number, ior, wavelengths):
    """Returns the index of refraction of materials `number` at the paths' hero wavelengths. ior: of the line d."""
    dispersion = _value(scene.material, number, rows.DISPERSION)
    return dispersed_index(ior, dispersion, wavelengths[0])


@device
def opacity(scene, number, uv, uv1, vertex_alpha, time):
    """Returns the probability, 0 ... 1, that a ray hits material `number` at this point rather than passes through."""
    chance = as_wide(_ONE, number)
    if scene.has.textures is not None:
        transparent = has_flag(scene, number, _TRANSPARENT)
        if any_of(transparent):
            alpha = each_lane(_alpha, transparent, (scene, number, uv, uv1, vertex_alpha, time))
            chance = where(transparent, alpha, chance)
    return chance


@device
def _alpha(scene, number, uv, uv1, vertex_alpha, time):
    """Returns the opacity of a material that may be transparent: alpha, or for an alpha-masked material 0 or 1."""
    alpha = _value(scene.material, number, rows.OPACITY) * vertex_alpha
    texture = _texture(scene, number, rows.BASE_TEXTURE)
    if texture >= 0:
        alpha *= sample_texture(scene, texture, uv, uv1, time)[3]
    if scene.material_flags[number] & rows.MASKED != 0:
        return _ONE if alpha >= _value(scene.material, number, rows.ALPHA_CUTOFF) else _ZERO
    return min(max(alpha, _ZERO), _ONE)


@device
def emission(scene, number, uv, uv1, front, time):
    """Returns the radiance emitted from the given side of material `number` at these texture coordinates."""
    shines = front | (_value(scene.material, number, rows.DOUBLE_SIDED) != _ZERO)
    radiance = where3(shines, _rgb(scene.material, number, rows.EMISSION), _BLACK)
    if scene.has.textures is not None:
        texture = u32(_texture(scene, number, rows.EMISSION_TEXTURE))
        textured = shines & (texture != _NO_TEXTURE)
        if any_of(textured):
            texels = each_lane(_texels, textured, (scene, texture, uv, uv1, time))
            radiance = where3(textured, vec.mul(radiance, texels), radiance)
    return radiance


@device
def _texels(scene, texture, uv, uv1, time):
    return sample_texture(scene, np.int32(texture), uv, uv1, time)


@device
def is_specular(material):
    """Returns True if the material scatters only into discrete directions, which light sampling cannot find."""
    if material.kind == CONDUCTOR:
        return material.roughness <= SMOOTH_GLASS
    return material.kind == MIRROR or material.kind == GLASS


@device
def eval_material(material, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local unit directions.

    wi may be below the surface if the material `transmits`.
    """
    if material.kind == METALLIC_ROUGHNESS:
        return eval_and_pdf_metallic_roughness(
            material.base, material.metallic, material.roughness, material.f0, material.f90, wo, wi
        )
    if material.kind == DIFFUSE:
        return eval_diffuse(material.base, wo, wi), pdf_diffuse(wo, wi)
    if material.kind >= CONDUCTOR:
        return eval_rare(material.has, material.kind, material.layers, material.eta, wo, wi)
    return _BLACK, _ZERO


@device
def eval_diffuse_lobes(material, wo, wi):
    """Returns f |cos| of the material's diffuse lobes alone, as they are part of `eval_material`."""
    if material.kind == METALLIC_ROUGHNESS:
        return eval_base_of_metallic_roughness(
            material.base, material.metallic, material.roughness, material.f0, material.f90, wo, wi
        )
    if material.kind == DIFFUSE:
        return eval_diffuse(material.base, wo, wi)
    if material.kind >= CONDUCTOR:
        return eval_diffuse_rare(material.has, material.kind, material.layers, wo, wi)
    return _BLACK


@device
def sample_material(material, wo, choose, u):
    """Samples a local direction: (wi, weight, pdf per steradian, radiance scale).

    pdf is 0 for a discrete direction. The radiance scale is eta**2 for a refraction, the inverse of the factor in its weight, for
    Russian roulette; else 1.
    """
    if material.kind == DIFFUSE:
        wi, weight, pdf = sample_diffuse(material.base, wo, u)
        return wi, weight, pdf, _ONE
    if material.kind == METALLIC_ROUGHNESS:
        wi, weight, pdf = sample_metallic_roughness(
            material.base, material.metallic, material.roughness, material.f0, material.f90, wo, choose, u
        )
        return wi, weight, pdf, _ONE
    if material.kind >= CONDUCTOR:
        return sample_rare(material.has, material.kind, material.layers, material.eta, wo, choose, u)
    if material.kind == MIRROR:
        wi, weight = sample_mirror(material.base, wo)
        return wi, weight, _ZERO, _ONE
    wi, weight, transmitted = sample_glass(material.base, material.eta, wo, choose)
    return wi, weight, _ZERO, material.eta * material.eta if transmitted else _ONE
