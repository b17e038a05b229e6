"""Sheen of upright fibres, which reflect at grazing angles: the Charlie distribution of KHR_materials_sheen.

Estevez & Kulla, "Production Friendly Microfacet Sheen BRDF" (2017), without their softened terminator, which is not reciprocal.
alpha is roughness squared. Zeltner's linearly transformed cosines, which Cycles uses, are not reciprocal either, and glTF
requires Charlie.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.albedo_tables import CHARLIE_LAMBDA, SIZE, table_path
from renderer.kernel.polynomial import exp, power
from renderer.kernel.sampling.warp import square_to_hemisphere, square_to_hemisphere_pdf

__all__ = ["eval_sheen", "pdf_sheen", "sample_sheen", "sheen_albedo", "sheen_mean_albedo"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_INV_2PI = np.float32(0.5 / math.pi)
_MIN_ROUGHNESS = np.float32(0.26)  # smoother sheen would reflect more than 1 at grazing angles
_LEAST_COSINE = np.float32(1e-4)  # lower bound of the cosine, for the same reason
_SMOOTH = tuple(np.float32(c) for c in CHARLIE_LAMBDA[0])
_ROUGH = tuple(np.float32(c) for c in CHARLIE_LAMBDA[1])
_TABLE = np.load(table_path("sheen_albedo"))
_LAST = np.float32(SIZE - 1)
_LAST_INTERVAL = SIZE - 2


@device
def _fit(t, k):
    return _ROUGH[k] + (_SMOOTH[k] - _ROUGH[k]) * t


@device
def _log_lambda(x, t):
    return _fit(t, 0) / (_ONE + _fit(t, 1) * power(x, _fit(t, 2))) + _fit(t, 3) * x + _fit(t, 4)


@subroutine
def _charlie_lambda(cosine, alpha):
    t = (_ONE - alpha) * (_ONE - alpha)
    if cosine < _HALF:
        return exp(_log_lambda(cosine, t))
    return exp(_TWO * _log_lambda(_HALF, t) - _log_lambda(_ONE - cosine, t))


@subroutine
def eval_sheen(roughness, wo, wi):
    """Returns f |cos| of white sheen for local directions."""
    if wi[2] <= _ZERO or wo[2] <= _ZERO:
        return _ZERO
    rough = max(roughness, _MIN_ROUGHNESS)
    alpha = rough * rough
    h = vec.normalize(vec.add(wo, wi))
    sine2 = max(_ONE - h[2] * h[2], _ZERO)
    density = (_TWO + _ONE / alpha) * power(sine2, _HALF / alpha) * _INV_2PI
    o = max(wo[2], _LEAST_COSINE)
    i = max(wi[2], _LEAST_COSINE)
    return density / ((_ONE + _charlie_lambda(o, alpha) + _charlie_lambda(i, alpha)) * _FOUR * o) * (wi[2] / i)


@device
def pdf_sheen(wi):
    """Returns the pdf of `sample_sheen`, per steradian."""
    return square_to_hemisphere_pdf(wi)


@device
def sample_sheen(u):
    """Samples a direction uniformly in the hemisphere, since the sheen lobe is wide with most of its weight near the horizon."""
    return square_to_hemisphere(u)


@device
def _between(a, b, t):
    return a + t * (b - a)


@subroutine
def sheen_albedo(cosine, roughness):
    """Returns the albedo of white sheen for one direction."""
    x = min(max(roughness, _MIN_ROUGHNESS), _ONE) * _LAST
    y = math.sqrt(min(max(cosine, _ZERO), _ONE)) * _LAST
    i = min(np.int64(x), _LAST_INTERVAL)
    j = min(np.int64(y), _LAST_INTERVAL)
    t = y - np.float32(j)
    smoother = _between(_TABLE[i, j], _TABLE[i, j + 1], t)
    rougher = _between(_TABLE[i + 1, j], _TABLE[i + 1, j + 1], t)
    return _between(smoother, rougher, x - np.float32(i))


@subroutine
def sheen_mean_albedo(roughness):
    """Returns the mean albedo of white sheen over the cosine-weighted hemisphere."""
    x = min(max(roughness, _MIN_ROUGHNESS), _ONE) * _LAST
    i = min(np.int64(x), _LAST_INTERVAL)
    return _between(_TABLE[SIZE, i], _TABLE[SIZE, i + 1], x - np.float32(i))
