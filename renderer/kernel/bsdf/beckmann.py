"""The anisotropic Beckmann distribution of microfacets: Gaussian slopes.

h is a microfacet's normal, with z > 0; directions have z > 0 unless stated otherwise. Lambda and the visible normals are exact up
to the error of `erf`. Sources: Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (2007); Heitz,
"Understanding the Masking-Shadowing Function" (JCGT 3(2), 2014); Jakob, "An Improved Visible Normal Sampling Routine for the
Beckmann Distribution" (2014).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.polynomial import erf, erf_inverse, exp

__all__ = ["beckmann_density", "beckmann_lambda", "sample_visible_beckmann"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INV_PI = np.float32(1.0 / math.pi)
_HALF_INV_SQRT_PI = np.float32(0.5 / math.sqrt(math.pi))
_NO_MASKING = np.float32(4.0)  # cotangent over alpha above which Lambda is below 1e-8
_LEAST = np.float32(1e-7)  # distance of a random number or an erf from the ends of its range
_STEPS = 16  # of Newton's method within a bracket


@subroutine
def beckmann_density(h, alpha_x, alpha_y):
    """Returns D(h): microfacet area per steradian of h and unit area of the surface."""
    x, y = h[0] / alpha_x, h[1] / alpha_y
    z2 = max(h[2] * h[2], _LEAST)
    return exp(-(x * x + y * y) / z2) * _INV_PI / (alpha_x * alpha_y * z2 * z2)


@subroutine
def beckmann_lambda(w, alpha_x, alpha_y):
    """Returns Smith's Lambda for the unit local direction w, which may be below the horizon."""
    x, y = w[0] * alpha_x, w[1] * alpha_y
    sine = math.sqrt(x * x + y * y)
    height = abs(w[2])
    if height >= _NO_MASKING * sine:
        return _ZERO
    a = height / sine
    return max(_HALF_INV_SQRT_PI * exp(-a * a) / a - _HALF * (_ONE - erf(a)), _ZERO)


@subroutine
def _visible_slope(tangent, u):
    """Samples a slope x <= 1 / tangent with density proportional to (1 - x tangent) exp(-x**2).

    tangent: of the angle between direction and normal, on a surface of alpha 1. Uses Newton's method on b = erf(x) within a
    bracket.
    """
    low, high = _LEAST - _ONE, _ONE - _LEAST
    whole = _ONE
    if tangent * _NO_MASKING > _ONE:
        a = _ONE / tangent
        high = min(erf(a), high)
        whole = _HALF * (_ONE + erf(a)) + _HALF_INV_SQRT_PI * tangent * exp(-a * a)
    target = u * whole
    b = low + u * (high - low)
    x = erf_inverse(b)
    for _ in range(_STEPS):
        missing = _HALF * (_ONE + b) + _HALF_INV_SQRT_PI * tangent * exp(-x * x) - target
        if missing > _ZERO:
            high = b
        else:
            low = b
        slope = _HALF * (_ONE - x * tangent)
        b = b - missing / slope if slope > _ZERO else low
        if not (b > low and b < high):
            b = _HALF * (low + high)
        x = erf_inverse(b)
    return x


@subroutine
def sample_visible_beckmann(wo, alpha_x, alpha_y, u):
    """Samples a microfacet normal (unit, local) from the distribution of normals visible from wo; u: two numbers in [0, 1)."""
    never_inline()
    v = (wo[0] * alpha_x, wo[1] * alpha_y, wo[2])
    sine = math.sqrt(v[0] * v[0] + v[1] * v[1])
    cosine, turn = (v[0] / sine, v[1] / sine) if sine > _ZERO else (_ONE, _ZERO)
    along = -_visible_slope(sine / max(v[2], _LEAST), u[0])
    across = erf_inverse(min(max(_TWO * u[1] - _ONE, _LEAST - _ONE), _ONE - _LEAST))
    x = cosine * along - turn * across
    y = turn * along + cosine * across
    return vec.normalize((x * alpha_x, y * alpha_y, _ONE))
