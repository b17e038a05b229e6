"""A smooth boundary between two dielectrics: reflection and refraction by Fresnel's equations."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec

__all__ = ["fresnel_dielectric", "sample_glass"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)


@device
def fresnel_dielectric(cosine, eta):
    """(reflectance of unpolarised light, cosine of refraction). eta: index beyond over index here; total reflection: (1, 0)."""
    sine2 = max(_ZERO, _ONE - cosine * cosine) / (eta * eta)
    if sine2 >= _ONE:
        return _ONE, _ZERO
    refracted = math.sqrt(_ONE - sine2)
    parallel = (eta * cosine - refracted) / (eta * cosine + refracted)
    perpendicular = (cosine - eta * refracted) / (cosine + eta * refracted)
    return _HALF * (parallel * parallel + perpendicular * perpendicular), refracted


@device
def sample_glass(tint, eta, wo, u):
    """(wi, weight, transmitted): reflects with Fresnel's probability, so that the weights are 1 and tint / eta**2.

    The tint colours what passes. Radiance is squeezed into a smaller cone on the denser side: the factor 1 / eta**2, which
    leaving the glass undoes (pbrt 4ed, 9.5.2).
    """
    reflectance, refracted = fresnel_dielectric(wo[2], eta)
    if u < reflectance:
        return (-wo[0], -wo[1], wo[2]), (_ONE, _ONE, _ONE), False
    inverse = _ONE / eta
    return (-wo[0] * inverse, -wo[1] * inverse, -refracted), vec.scale(tint, inverse * inverse), True
