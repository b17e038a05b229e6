"""Multiple scattering between GGX microfacets: compensates the energy that single scattering loses with a diffuse-like lobe.

Kulla & Conty, "Revisiting Physically Based Shading at Imageworks" (SIGGRAPH course, 2017): a lobe proportional to
(1 - E(wo)) (1 - E(wi)), which is reciprocal, and with which a white metal of any roughness reflects exactly all light. E is the
single-scattering albedo of perfectly reflecting microfacets. It is stored split for Schlick's Fresnel: the albedo for F0 and F90
is F0 A + F90 B, and E = A + B. Tables: albedo_tables.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel.bsdf.albedo_tables import SIZE, table_path
from renderer.kernel.fetch import columns
from renderer.wide.values import to_float, to_int

__all__ = ["ggx_albedo", "ggx_mean_albedo", "multiple_scattering", "schlick_mean"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TABLE = np.load(table_path("ggx_albedo"))
_LAST = np.float32(SIZE - 1)
_LAST_INTERVAL = np.float32(SIZE - 2)
_COSINES = np.uint32(SIZE)
_MEANS = np.uint32(SIZE * SIZE)
_NEXT = np.uint32(1)
_MEAN_WEIGHT = np.float32(1.0 / 21.0)  # of (1 - cosine)**5 over the cosine-weighted hemisphere


@device
def _between(a, b, t):
    return a + t * (b - a)


@device
def _node(x):
    """Returns (index of the table node below x, the fraction of the way to the next node).

    x: position along a table axis, 0 at the first node to 1 at the last. For NaN, as in unused lanes, the node is valid too.
    """
    x = min(_ONE, max(_ZERO, x)) * _LAST
    i = to_int(min(_LAST_INTERVAL, x))
    return i, x - to_float(i)


@device
def _pair(number, t):
    """Returns the albedo terms (A, B) interpolated in the flat table, at fraction t of the way from node `number` to the next."""
    a, b, next_a, next_b = columns(_TABLE, number, 2, 0, 4)
    return _between(a, next_a, t), _between(b, next_b, t)


@subroutine
def ggx_albedo(cosine, roughness):
    """Returns the albedo terms (A, B) of GGX for one direction: its albedo is F0 A + F90 B.

    roughness: the square root of alpha, 0 ... 1.
    """
    i, s = _node(roughness)
    j, t = _node(math.sqrt(max(_ZERO, cosine)))
    smoother_a, smoother_b = _pair(i * _COSINES + j, t)
    rougher_a, rougher_b = _pair((i + _NEXT) * _COSINES + j, t)
    return _between(smoother_a, rougher_a, s), _between(smoother_b, rougher_b, s)


@subroutine
def ggx_mean_albedo(roughness):
    """Returns the means of `ggx_albedo`'s terms (A, B) over the cosine-weighted hemisphere."""
    i, s = _node(roughness)
    return _pair(i + _MEANS, s)


@device
def schlick_mean(f0, f90):
    """Returns the cosine-weighted mean over the hemisphere of Schlick's reflectance, for one channel."""
    return f0 + (f90 - f0) * _MEAN_WEIGHT


@device
def multiple_scattering(mean_fresnel, mean_albedo):
    """Returns the fraction of the light lost by single scattering that leaves after further bounces (Fdez-Aguera 2019).

    mean_fresnel: fraction of the light that each bounce reflects. mean_albedo: single-scattering albedo of the microfacets.
    """
    return mean_fresnel * mean_fresnel * mean_albedo / (_ONE - mean_fresnel * (_ONE - mean_albedo))
