"""The scattering models that take eight paths at once, and what each reads of a material's row.

A model's `fetch` gives what its `evaluate` and `sample` take first. evaluate: (f |cos|, pdf); sample: (wi, weight, pdf, eta2), as
`sample_material` of renderer/kernel/material/material.py gives them.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import COLUMNS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.conductor import eval_and_pdf_conductor, sample_conductor, sample_smooth_conductor
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import eval_and_pdf_metallic_roughness, sample_metallic_roughness
from renderer.kernel.bsdf.microfacet import MIN_ALPHA
from renderer.kernel.bsdf.mirror import sample_mirror
from renderer.kernel.fetch import columns
from renderer.wide.values import nil, where

__all__ = [
    "evaluate_conductor",
    "evaluate_diffuse",
    "evaluate_metallic_roughness",
    "fetch_base",
    "fetch_conductor",
    "fetch_glass",
    "fetch_metallic_roughness",
    "scatter_conductor",
    "scatter_diffuse",
    "scatter_glass",
    "scatter_metallic_roughness",
    "scatter_mirror",
    "scatter_smooth_conductor",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)


@device
def fetch_base(scene, material, front):
    """The colour."""
    return (columns(scene.material, material, COLUMNS, rows.BASE, 3),)


@device
def evaluate_diffuse(m, wo, wi):
    """Lambert."""
    return eval_diffuse(m[0], wo, wi), pdf_diffuse(wo, wi)


@device
def scatter_diffuse(m, wo, choose, u):
    """Lambert."""
    wi, weight, pdf = sample_diffuse(m[0], wo, u)
    return wi, weight, pdf, nil(choose) + _ONE


@device
def scatter_mirror(m, wo, choose, u):
    """A mirror."""
    wi, weight = sample_mirror(m[0], wo)
    return wi, weight, nil(choose), nil(choose) + _ONE


@device
def fetch_glass(scene, material, front):
    """(tint, eta)."""
    ior = columns(scene.material, material, COLUMNS, rows.IOR, 1)[0]
    return columns(scene.material, material, COLUMNS, rows.BASE, 3), where(front, ior, _ONE / ior)


@device
def scatter_glass(m, wo, choose, u):
    """Smooth glass."""
    tint, eta = m
    wi, weight, transmitted = sample_glass(tint, eta, wo, choose)
    return wi, weight, nil(choose), where(transmitted, eta * eta, _ONE)


@device
def fetch_metallic_roughness(scene, material, front):
    """(base, metallic, roughness, f0, f90)."""
    base = columns(scene.material, material, COLUMNS, rows.BASE, 3)
    metallic, roughness = columns(scene.material, material, COLUMNS, rows.METALLIC, 2)
    f90 = columns(scene.material, material, COLUMNS, rows.SPECULAR, 1)[0]
    return base, metallic, roughness, vec.scale(columns(scene.material, material, COLUMNS, rows.F0, 3), f90), f90


@device
def evaluate_metallic_roughness(m, wo, wi):
    """GGX over a diffuse base."""
    base, metallic, roughness, f0, f90 = m
    return eval_and_pdf_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi)


@device
def scatter_metallic_roughness(m, wo, choose, u):
    """GGX over a diffuse base."""
    base, metallic, roughness, f0, f90 = m
    wi, weight, pdf = sample_metallic_roughness(base, metallic, roughness, f0, f90, wo, choose, u)
    return wi, weight, pdf, nil(choose) + _ONE


@device
def fetch_conductor(scene, material, front):
    """(eta, k, mean Fresnel, roughness, both alphas, cosine and sine of the anisotropy's angle)."""
    table = scene.material
    eta = columns(table, material, COLUMNS, rows.ETA, 3)
    k = columns(table, material, COLUMNS, rows.K, 3)
    mean = columns(table, material, COLUMNS, rows.MEAN_FRESNEL, 3)
    roughness = columns(table, material, COLUMNS, rows.ROUGHNESS, 1)[0]
    strength, cosine, sine = columns(table, material, COLUMNS, rows.ANISOTROPY, 3)
    alpha = max(roughness * roughness, MIN_ALPHA)
    along = alpha + (_ONE - alpha) * strength * strength
    roughness = where(strength != _ZERO, math.sqrt(_HALF * (along + alpha)), roughness)
    return eta, k, mean, roughness, along, alpha, cosine, sine


@device
def _turned(cosine, sine, w):
    """w in the anisotropy's frame; by the opposite sine, back from it."""
    return cosine * w[0] + sine * w[1], cosine * w[1] - sine * w[0], w[2]


@device
def evaluate_conductor(m, wo, wi):
    """A rough metal."""
    eta, k, mean, roughness, along, across, cosine, sine = m
    return eval_and_pdf_conductor(eta, k, mean, roughness, along, across, _turned(cosine, sine, wo), _turned(cosine, sine, wi))


@device
def scatter_conductor(m, wo, choose, u):
    """A rough metal."""
    eta, k, mean, roughness, along, across, cosine, sine = m
    wi, weight, pdf = sample_conductor(eta, k, mean, roughness, along, across, _turned(cosine, sine, wo), choose, u)
    return _turned(cosine, -sine, wi), weight, pdf, nil(choose) + _ONE


@device
def scatter_smooth_conductor(m, wo, choose, u):
    """An even metal."""
    wi, weight = sample_smooth_conductor(m[0], m[1], wo)
    return wi, weight, nil(choose), nil(choose) + _ONE
