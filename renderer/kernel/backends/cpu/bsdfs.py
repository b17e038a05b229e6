"""BSDF evaluation and sampling for each kind of material, eight paths at a time.

Each function returns six values: f |cos| and the pdf for the light direction wi (both 0 for specular materials), then the
sampled direction, its weight, pdf, and radiance scale eta**2; see `eval_material` and `sample_material` in
renderer/kernel/material/material.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import COLUMNS, CONDUCTOR, GLASS, LAYER_SLOTS
from renderer.jit import device, local_floats, never_inline, subroutine
from renderer.kernel.bsdf.conductor import eval_and_pdf_conductor, sample_conductor, sample_smooth_conductor
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import (
    eval_and_pdf_metallic_roughness,
    eval_base_of_metallic_roughness,
    sample_metallic_roughness,
)
from renderer.kernel.bsdf.microfacet import MIN_ALPHA
from renderer.kernel.bsdf.mirror import sample_mirror
from renderer.kernel.fetch import columns
from renderer.kernel.material.material import dielectric_reflectance, look_up_layers, relative_index
from renderer.kernel.material.rare_materials import eval_diffuse_rare, eval_rare, sample_rare
from renderer.kernel.medium.henyey_greenstein import (
    eval_henyey_greenstein,
    pdf_henyey_greenstein,
    sample_henyey_greenstein,
)
from renderer.kernel.spectrum.indices import conductor_at
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, lookup, u32, where, where3, zero_like

__all__ = [
    "Material",
    "eval_and_sample_conductor",
    "eval_and_sample_diffuse",
    "eval_and_sample_in_medium",
    "eval_and_sample_metallic_roughness",
    "eval_and_sample_rare",
    "eval_and_sample_specular",
    "eval_diffuse_lobe_diffuse",
    "eval_diffuse_lobe_metallic_roughness",
    "eval_diffuse_lobe_rare",
    "eval_no_lobe",
]

_ONE = np.float32(1.0)
_CONDUCTOR, _GLASS = np.uint32(CONDUCTOR), np.uint32(GLASS)


class Material(NamedTuple):
    """The materials at the vertices of eight paths.

    In scenes without textures and layers the fields between `front` and `shading` are not set; they are read from the scene's
    material table instead.
    """

    material: Any
    front: Any
    base: Any
    metallic: Any
    roughness: Any
    eta: Any
    uv: Any
    uv1: Any
    shading: Any  # shading normal without a normal map
    frame: Any  # shading frame
    time: Any  # shutter time; None for a scene without motion
    wavelengths: Any  # of the paths (kernel/spectrum); None in RGB


@device
def _base(scene, m):
    if scene.has.textures is not None:
        base = m.base
    else:
        base = columns(scene.material, m.material, COLUMNS, rows.BASE, 3)
    return base


@device
def _metallic_roughness(scene, m):
    if scene.has.textures is not None:
        pair = m.metallic, m.roughness
    else:
        pair = columns(scene.material, m.material, COLUMNS, rows.METALLIC, 2)
    return pair


@device
def eval_and_sample_diffuse(scene, m, wo, wi, choose, u):
    """Evaluates and samples the Lambertian model."""
    base = _base(scene, m)
    on, weight, pdf = sample_diffuse(base, wo, u)
    return eval_diffuse(base, wo, wi), pdf_diffuse(wo, wi), on, weight, pdf, zero_like(choose) + _ONE


@device
def _eta(scene, m):
    """Returns the relative index of refraction of eight materials: beyond the surface over that on the viewer's side."""
    if scene.has.layers is not None:
        eta = m.eta
    else:
        ior = columns(scene.material, m.material, COLUMNS, rows.IOR, 1)[0]
        eta = relative_index(ior, m.front)
    return eta


@device
def _indices(scene, m):
    """Returns (eta, k, mean reflectance over the hemisphere) of eight conductors, three channels each."""
    if scene.spectrum is not None:
        found = conductor_at(scene.spectrum, m.material, m.wavelengths)
    else:
        table = scene.material
        eta, k = columns(table, m.material, COLUMNS, rows.ETA, 3), columns(table, m.material, COLUMNS, rows.K, 3)
        found = eta, k, columns(table, m.material, COLUMNS, rows.MEAN_FRESNEL, 3)
    return found


@device
def eval_and_sample_specular(scene, m, wo, wi, choose, u):
    """Samples mirrors, smooth glass and smooth conductors; the evaluation is 0."""
    kind = u32(lookup(scene.material_kind, m.material))
    base, none = _base(scene, m), zero_like(choose)
    on, weight = sample_mirror(base, wo)
    eta2 = none + _ONE
    glass = kind == _GLASS
    if any_of(glass):
        eta = _eta(scene, m)
        through, passing, transmitted = sample_glass(base, eta, wo, choose)
        on, weight = where3(glass, through, on), where3(glass, passing, weight)
        eta2 = where(glass & transmitted, eta * eta, _ONE)
    metal = kind == _CONDUCTOR
    if any_of(metal):
        eta, k, _ = _indices(scene, m)
        weight = where3(metal, sample_smooth_conductor(eta, k, wo)[1], weight)
    return (none, none, none), none, on, weight, none, eta2


@device
def eval_and_sample_metallic_roughness(scene, m, wo, wi, choose, u):
    """Evaluates and samples the metallic-roughness model, GGX over a diffuse base."""
    base = _base(scene, m)
    metallic, roughness = _metallic_roughness(scene, m)
    f0, f90 = dielectric_reflectance(scene, m.material, m.wavelengths)
    f, light_pdf = eval_and_pdf_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi)
    on, weight, pdf = sample_metallic_roughness(base, metallic, roughness, f0, f90, wo, choose, u)
    return f, light_pdf, on, weight, pdf, zero_like(choose) + _ONE


@device
def eval_and_sample_conductor(scene, m, wo, wi, choose, u):
    """Evaluates and samples rough conductors with isotropic GGX facets."""
    eta, k, mean = _indices(scene, m)
    roughness = _metallic_roughness(scene, m)[1]
    alpha = max(roughness * roughness, MIN_ALPHA)
    f, light_pdf = eval_and_pdf_conductor(None, eta, k, mean, roughness, alpha, alpha, wo, wi)
    on, weight, pdf = sample_conductor(None, eta, k, mean, roughness, alpha, alpha, wo, choose, u)
    return f, light_pdf, on, weight, pdf, zero_like(choose) + _ONE


@device
def eval_and_sample_in_medium(scene, m, wo, wi, choose, u):
    """Evaluates and samples the phase functions at vertices in a medium.

    The field `roughness` of `m` contains the phase function's mean cosine g.
    """
    one = zero_like(choose) + _ONE
    phase = eval_henyey_greenstein(m.roughness, wi)
    on = sample_henyey_greenstein(m.roughness, u)
    pdf = pdf_henyey_greenstein(m.roughness, on)
    return (phase, phase, phase), pdf_henyey_greenstein(m.roughness, wi), on, (one, one, one), pdf, one


@device
def eval_no_lobe(scene, m, wo, wi):
    """Returns the diffuse part of f |cos| for materials without a diffuse lobe: 0."""
    none = zero_like(wi[2])
    return none, none, none


@device
def eval_diffuse_lobe_diffuse(scene, m, wo, wi):
    """Returns the diffuse part of f |cos|; of the Lambertian model all of it."""
    return eval_diffuse(_base(scene, m), wo, wi)


@device
def eval_diffuse_lobe_metallic_roughness(scene, m, wo, wi):
    """Returns the diffuse part of f |cos| of the metallic-roughness model."""
    metallic, roughness = _metallic_roughness(scene, m)
    f0, f90 = dielectric_reflectance(scene, m.material, m.wavelengths)
    return eval_base_of_metallic_roughness(_base(scene, m), metallic, roughness, f0, f90, wo, wi)


@subroutine
def _diffuse_lobe_of_one(scene, material, base, metallic, roughness, uv, uv1, shading, s, t, n, time, wavelengths, wo, wi):
    never_inline()
    layers = local_floats(LAYER_SLOTS)
    look_up_layers(scene, material, base, metallic, roughness, shading, uv, uv1, (s, t, n), layers, time, wavelengths)
    return eval_diffuse_rare(scene.has, scene.material_kind[material], layers, wo, wi)


@device
def eval_diffuse_lobe_rare(scene, m, wo, wi):
    """Returns the diffuse part of f |cos| of the kinds of materials that have no eight-lane form."""
    s, t, n = m.frame
    known = (m.material, m.base, m.metallic, m.roughness, m.uv, m.uv1, m.shading, s, t, n, m.time, m.wavelengths)
    return each_lane(_diffuse_lobe_of_one, wi[2] == wi[2], (scene, *known, wo, wi))


@subroutine
def _one_rare(
    scene, material, front, base, metallic, roughness, eta, uv, uv1, shading, s, t, n, time, wavelengths, wo, wi, choose, u
):
    """Evaluates and samples the material of a single path, for the kinds of materials without an eight-lane form."""
    never_inline()
    layers = local_floats(LAYER_SLOTS)
    look_up_layers(scene, material, base, metallic, roughness, shading, uv, uv1, (s, t, n), layers, time, wavelengths)
    kind = scene.material_kind[material]
    f, light_pdf = eval_rare(scene.has, kind, layers, eta, wo, wi)
    on, weight, pdf, eta2 = sample_rare(scene.has, kind, layers, eta, wo, choose, u)
    return f, light_pdf, on, weight, pdf, eta2


@device
def eval_and_sample_rare(scene, m, wo, wi, choose, u):
    """Evaluates and samples the kinds of materials that have no eight-lane form, one path at a time."""
    s, t, n = m.frame
    known = (m.material, m.front, m.base, m.metallic, m.roughness, m.eta, m.uv, m.uv1, m.shading, s, t, n, m.time, m.wavelengths)
    return each_lane(_one_rare, choose == choose, (scene, *known, wo, wi, choose, u))
