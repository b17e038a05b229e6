"""The anisotropic GGX distribution of microfacets, with Smith's height-correlated masking and shadowing.

h is a microfacet's normal, with z > 0; directions have z > 0 unless stated otherwise. Sources: Walter et al., "Microfacet
Models for Refraction through Rough Surfaces" (2007); Heitz, "Understanding the Masking-Shadowing Function" (JCGT 3(2), 2014);
Dupuy & Benyoub, "Sampling Visible GGX Normals with Spherical Caps" (2023).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.polynomial import sincos_turns

__all__ = ["MIN_ALPHA", "ggx_density", "pdf_visible_normal", "sample_visible_normal", "smith_lambda"]

MIN_ALPHA = np.float32(1e-3)  # looks like a mirror, and the density still fits float32

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_INV_PI = np.float32(1.0 / math.pi)


@device
def ggx_density(h, alpha_x, alpha_y):
    """Returns D(h): microfacet area per steradian of h and unit area of the surface."""
    x = h[0] / alpha_x
    y = h[1] / alpha_y
    s = x * x + y * y + h[2] * h[2]
    return _INV_PI / (alpha_x * alpha_y * s * s)


@device
def smith_lambda(w, alpha_x, alpha_y):
    """Returns Smith's Lambda: G1 = 1 / (1 + Lambda), G2 = 1 / (1 + Lambda_o + Lambda_i). w may be below the horizon."""
    x = w[0] * alpha_x
    y = w[1] * alpha_y
    return (math.sqrt(_ONE + (x * x + y * y) / (w[2] * w[2])) - _ONE) * _HALF


@device
def sample_visible_normal(wo, alpha_x, alpha_y, u):
    """Samples a local microfacet normal from the distribution of normals visible from wo; u: two numbers in [0, 1)."""
    v = vec.normalize((wo[0] * alpha_x, wo[1] * alpha_y, wo[2]))
    z = (_ONE - u[0]) * (_ONE + v[2]) - v[2]
    radius = math.sqrt(min(max(_ONE - z * z, _ZERO), _ONE))
    sine, cosine = sincos_turns(u[1])
    h = (radius * cosine + v[0], radius * sine + v[1], z + v[2])
    return vec.normalize((h[0] * alpha_x, h[1] * alpha_y, h[2]))


@device
def pdf_visible_normal(wo, h, alpha_x, alpha_y):
    """Returns the pdf of `sample_visible_normal`, per steradian of h.

    The pdf of the reflected direction is this divided by 4 wo.h.
    """
    masking = _ONE + smith_lambda(wo, alpha_x, alpha_y)
    return max(vec.dot(wo, h), _ZERO) * ggx_density(h, alpha_x, alpha_y) / (masking * wo[2])
