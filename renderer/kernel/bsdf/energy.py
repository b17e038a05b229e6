"""The light that GGX mirrors scatter more than once: what single scattering loses, given back without a direction of its own.

Kulla & Conty, "Revisiting Physically Based Shading at Imageworks" (SIGGRAPH course, 2017): a lobe in proportion to
(1 - E(wo)) (1 - E(wi)), which is reciprocal, and makes a white metal of any roughness reflect exactly all light. E is the
single-scatter albedo of a perfect mirror's microfacets. It is kept split for Schlick's Fresnel: F0 A + F90 B is the albedo
of any other, and E = A + B. Tables: albedo_tables.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel.bsdf.albedo_tables import SIZE, table_path

__all__ = ["ggx_albedo", "ggx_mean_albedo", "multiple_scattering", "schlick_mean"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TABLE = np.load(table_path("ggx_albedo"))
_LAST = np.float32(SIZE - 1)
_MOST = SIZE - 2
_MEAN_WEIGHT = np.float32(1.0 / 21.0)  # of (1 - cosine)**5 over the cosine-weighted hemisphere


@device
def _between(a, b, t):
    return a + t * (b - a)


@subroutine
def ggx_albedo(cosine, roughness):
    """(A, B) towards one direction; roughness is the square root of alpha, 0 ... 1."""
    x = min(roughness, _ONE) * _LAST
    y = math.sqrt(min(max(cosine, _ZERO), _ONE)) * _LAST
    i = min(np.int64(x), _MOST)
    j = min(np.int64(y), _MOST)
    s = x - np.float32(i)
    t = y - np.float32(j)
    smoother_a = _between(_TABLE[i, j, 0], _TABLE[i, j + 1, 0], t)
    smoother_b = _between(_TABLE[i, j, 1], _TABLE[i, j + 1, 1], t)
    rougher_a = _between(_TABLE[i + 1, j, 0], _TABLE[i + 1, j + 1, 0], t)
    rougher_b = _between(_TABLE[i + 1, j, 1], _TABLE[i + 1, j + 1, 1], t)
    return _between(smoother_a, rougher_a, s), _between(smoother_b, rougher_b, s)


@subroutine
def ggx_mean_albedo(roughness):
    """(A, B), their means over the cosine-weighted hemisphere."""
    x = min(roughness, _ONE) * _LAST
    i = min(np.int64(x), _MOST)
    s = x - np.float32(i)
    return _between(_TABLE[SIZE, i, 0], _TABLE[SIZE, i + 1, 0], s), _between(_TABLE[SIZE, i, 1], _TABLE[SIZE, i + 1, 1], s)


@device
def schlick_mean(f0, f90):
    """Schlick's reflectance of one channel over the cosine-weighted hemisphere."""
    return f0 + (f90 - f0) * _MEAN_WEIGHT


@device
def multiple_scattering(mean_fresnel, mean_albedo):
    """What of the light that single scattering loses comes out later, if each bounce keeps mean_fresnel (Fdez-Aguera 2019)."""
    return mean_fresnel * mean_fresnel * mean_albedo / (_ONE - mean_fresnel * (_ONE - mean_albedo))
