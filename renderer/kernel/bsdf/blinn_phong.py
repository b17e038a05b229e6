"""The empirical Blinn-Phong model: diffuse reflectance kd, and a highlight ks (n.h)**shininess normalised at normal incidence.

Blinn, "Models of Light Reflection for Computer Synthesized Pictures" (1977). The highlight's factor is exact for light along the
normal: (s + 2)(s + 4) / (8 pi (2**(-s / 2) + s)) (Giesen, "Phong Normalization Factor Derivation", 2009); at other angles less is
reflected. If kd + ks exceeds 1, both are scaled down to a sum of 1 (scene/material.py).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.polynomial import exp2, power, sincos_turns
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf

__all__ = ["eval_and_pdf_blinn_phong", "eval_base_of_blinn_phong", "sample_blinn_phong"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
_INV_8PI = np.float32(0.125 / math.pi)
_LEAST = np.float32(1e-6)


@device
def _choice(kd, ks):
    """Returns the probability, 0 ... 1, of sampling the highlight: its fraction of the reflectances kd + ks."""
    highlight = vec.luminance(ks)
    return highlight / max(highlight + vec.luminance(kd), _LEAST)


@device
def eval_base_of_blinn_phong(kd, wo, wi):
    """Returns f |cos| of the diffuse lobe alone, for local directions."""
    return vec.scale(kd, max(wi[2], _ZERO) * _INV_PI)


@device
def eval_and_pdf_blinn_phong(kd, ks, shininess, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions."""
    if wi[2] <= _ZERO or wo[2] <= _ZERO:
        return (_ZERO, _ZERO, _ZERO), _ZERO
    h = vec.normalize(vec.add(wo, wi))
    peak = power(min(h[2], _ONE), shininess)
    normalize = (shininess + _TWO) * (shininess + _FOUR) * _INV_8PI / (exp2(-_HALF * shininess) + shininess)
    f = vec.add(eval_base_of_blinn_phong(kd, wo, wi), vec.scale(ks, normalize * peak * wi[2]))
    choice = _choice(kd, ks)
    density = (shininess + _ONE) * _INV_2PI * peak / (_FOUR * max(vec.dot(wo, h), _LEAST))
    return f, choice * density + (_ONE - choice) * square_to_cosine_hemisphere_pdf(wi)


@device
def sample_blinn_phong(kd, ks, shininess, wo, choose, u):
    """Samples the highlight around the mirror direction, or the diffuse lobe; returns local (wi, weight, pdf).

    choose: selects one of the two, by their reflectances.
    """
    if choose < _choice(kd, ks):
        z = power(_ONE - u[0], _ONE / (shininess + _ONE))
        radius = math.sqrt(max(_ONE - z * z, _ZERO))
        sine, cosine = sincos_turns(u[1])
        h = (radius * cosine, radius * sine, z)
        wi = vec.sub(vec.scale(h, _TWO * vec.dot(wo, h)), wo)
    else:
        wi = square_to_cosine_hemisphere(u)
    f, pdf = eval_and_pdf_blinn_phong(kd, ks, shininess, wo, wi)
    if pdf <= _ZERO:
        return wi, (_ZERO, _ZERO, _ZERO), _ZERO
    return wi, vec.scale(f, _ONE / pdf), pdf
