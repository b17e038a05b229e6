"""Rough plastic: a diffuse base under a rough dielectric coat, with single scattering between microfacets.

The coat's facets transmit light on its way in and out. With T(w) the transmitted fraction of light from w, and R the fraction of
diffuse light from inside that the facets reflect back, a base of reflectance d scatters

    f(wo, wi) = d / (1 - R d') T(wo) T(wi) / (pi eta**2),   d' = d if nonlinear, else 1.

Source: W. Jakob, Mitsuba 3, src/bsdfs/roughplastic.cpp, with the same separable shadowing, G1(wo) G1(wi). Table of T and R:
albedo_tables.py.

A material is given as its parameter row m (renderer/arrays/rows.py) with textures looked up by `resolve` in
kernel/material/layers.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import ALPHA_X, HAS_BECKMANN, HAS_NONLINEAR
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.albedo_tables import COAT_NODES, MOST_BEND, table_path
from renderer.kernel.bsdf.facets import facet_density, facet_lambda, sample_visible_facet
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere

__all__ = ["eval_and_pdf_plastic", "eval_base_of_plastic", "sample_plastic"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST = np.float32(1e-6)
_MIN_CHOICE = np.float32(0.125)
_TABLE = np.concatenate([np.load(table_path(name)) for name in ("ggx_coat", "beckmann_coat")])
_BENDS, _ROUGHNESSES, _COSINES = COAT_NODES
_BENDS_PER_UNIT = np.float32((_BENDS - 1) / MOST_BEND)


@device
def _node(x, nodes):
    """Returns the index of the table node below x, and x's fraction of the way to the next node.

    x: 0 to nodes - 1, in units of nodes.
    """
    x = min(max(x, _ZERO), np.float32(nodes - 1))
    i = min(np.int64(x), nodes - 2)
    return i, x - np.float32(i)


@device
def _mix(a, b, t):
    return a + t * (b - a)


@device
def _place(m):
    """Returns the material's position in the coat table, along the axes of index of refraction and of roughness.

    Four values: node by index of refraction, fraction to the next node, node by roughness, fraction to the next node.
    """
    ior = m[rows.IOR]
    k, r = _node((ior - _ONE) / (ior + _ONE) * _BENDS_PER_UNIT, _BENDS)
    i, s = _node(m[rows.ROUGHNESS] * np.float32(_ROUGHNESSES - 1), _ROUGHNESSES)
    return k + (_BENDS if m[HAS_BECKMANN] != _ZERO else 0), r, i, s


@device
def _at(k, r, i, s, j):
    here = _mix(_TABLE[k, i, j], _TABLE[k, i + 1, j], s)
    return _mix(here, _mix(_TABLE[k + 1, i, j], _TABLE[k + 1, i + 1, j], s), r)


@subroutine
def _passing(m, cosine):
    """Returns T of the module's equation: the fraction of light from outside that the coat's facets transmit.

    cosine: of the angle between the light's direction and the normal.
    """
    never_inline()
    k, r, i, s = _place(m)
    j, t = _node(math.sqrt(max(cosine, _ZERO)) * np.float32(_COSINES - 1), _COSINES)
    return _mix(_at(k, r, i, s, j), _at(k, r, i, s, j + 1), t)


@device
def _inner(m):
    """Returns the fraction of diffuse light from inside that the coat's facets reflect back. m: the parameters."""
    k, r, i, s = _place(m)
    return _at(k, r, i, s, _COSINES)


@device
def _tint(m):
    """Returns the colour factor, rgb, of the coat's reflection."""
    scale = m[rows.SPECULAR]
    return m[rows.SPECULAR_COLOR] * scale, m[rows.SPECULAR_COLOR + 1] * scale, m[rows.SPECULAR_COLOR + 2] * scale


@device
def _paint(m, inner):
    """Returns d / (1 - R d') / eta**2, rgb: the base's factor in the module's equation. inner: R."""
    base = m[rows.BASE], m[rows.BASE + 1], m[rows.BASE + 2]
    squeeze = _ONE / (m[rows.IOR] * m[rows.IOR])
    if m[HAS_NONLINEAR] != _ZERO:
        return (
            base[0] * squeeze / (_ONE - inner * base[0]),
            base[1] * squeeze / (_ONE - inner * base[1]),
            base[2] * squeeze / (_ONE - inner * base[2]),
        )
    return vec.scale(base, squeeze / (_ONE - inner))


@device
def _choice(m, passing, paint):
    """Returns the probability, 0 to 1, of sampling the coat's facets rather than the diffuse base.

    passing: T for direction wo. paint: from `_paint`.
    """
    mirrored = (_ONE - passing) * vec.luminance(_tint(m))
    below = passing * vec.luminance(paint)
    return max(mirrored / max(mirrored + below, _LEAST), _MIN_CHOICE)


@subroutine
def eval_base_of_plastic(m, wo, wi):
    """Returns f |cos| of the diffuse base alone, for local directions."""
    if wo[2] <= _ZERO or wi[2] <= _ZERO:
        return _BLACK
    return _base_lobe(m, _paint(m, _inner(m)), _passing(m, wo[2]), wi)


@device
def _base_lobe(m, paint, passing_o, wi):
    return vec.scale(paint, passing_o * _passing(m, wi[2]) * (wi[2] * _INV_PI))


@subroutine
def eval_and_pdf_plastic(m, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions."""
    if wo[2] <= _ZERO or wi[2] <= _ZERO:
        return _BLACK, _ZERO
    alpha, beckmann = m[ALPHA_X], m[HAS_BECKMANN]
    passing_o = _passing(m, wo[2])
    paint = _paint(m, _inner(m))
    choice = _choice(m, passing_o, paint)
    h = vec.normalize(vec.add(wo, wi))
    masked_o = _ONE + facet_lambda(beckmann, wo, alpha, alpha)
    masked_i = _ONE + facet_lambda(beckmann, wi, alpha, alpha)
    density = facet_density(beckmann, h, alpha, alpha) / (_FOUR * wo[2] * masked_o)
    reflectance, _ = fresnel_dielectric(vec.dot(wo, h), m[rows.IOR])
    cosine = wi[2] * _INV_PI
    f = _base_lobe(m, paint, passing_o, wi)
    f = vec.add(f, vec.scale(_tint(m), reflectance * density / masked_i))
    return f, choice * density + (_ONE - choice) * cosine


@subroutine
def sample_plastic(m, wo, choose, u):
    """Samples a local direction; returns (wi, weight, pdf per steradian).

    choose: selects the coat or the diffuse base. u: selects the direction.
    """
    if choose < _choice(m, _passing(m, wo[2]), _paint(m, _inner(m))):
        h = sample_visible_facet(m[HAS_BECKMANN], wo, m[ALPHA_X], m[ALPHA_X], u)
        wi = vec.sub(vec.scale(h, _TWO * vec.dot(wo, h)), wo)
    else:
        wi = square_to_cosine_hemisphere(u)
    f, pdf = eval_and_pdf_plastic(m, wo, wi)
    if pdf <= _ZERO:
        return wi, _BLACK, _ZERO
    return wi, vec.scale(f, _ONE / pdf), pdf
