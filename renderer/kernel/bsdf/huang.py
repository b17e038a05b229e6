"""The hair BSDF of Huang et al., for fibres whose cross-section is an ellipse and whose surface is a rough dielectric.

A ray meets the fibre at a point of its cross-section. Light is reflected there (R), or is refracted by a microfacet, crosses
the fibre, and is refracted out by a second microfacet (TT), or reflected by it and refracted out by a third (TRT). What stays
inside leaves with a residual lobe, as in Chiang et al.'s model. R has a closed form. TT and TRT are integrals over the
microfacets before the last one: the mean over POINTS visible normals of each, from a lattice that is shifted by a hash of the
direction wo. Over the shifts, the mean of that is the integral; `sample_huang` samples the lattice's mean itself. So a fibre seen
close up has the model's near field, and the mean over its width is the far field.

Sources: Huang, Hullin & Hanika, "A Microfacet-based Hair Scattering Model" (2022); Chiang, Bitterli, Tappan & Burley (2016) for
the residual lobe. As in Cycles, each boundary is divided by its single-scattering albedo, which makes up for the light that
shadowed microfacets would scatter again.

The local frame is that of hair.py: x is the fibre's direction from root to tip, z the normal of its cross-section, and wi may
point to any side. The axes of the ellipse are (major, fibre, minor); the major radius is 1. A material is given as its parameter
row m, with HUANG_NORMAL filled by `resolve` in kernel/material/layers.py.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.facets import facet_density, facet_lambda, sample_visible_facet
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.bsdf.glass_energy import glass_albedo
from renderer.kernel.bsdf.hair import absorption_of, eval_longitudinal, sample_longitudinal
from renderer.kernel.polynomial import exp, sincos_turns
from renderer.kernel.sampling.sampler import hash4
from renderer.wide.values import to_float, u32

__all__ = ["POINTS", "eval_and_pdf_huang", "sample_huang"]

POINTS = 4  # of the lattice

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_INV_2PI = np.float32(0.5 / math.pi)
_SHARE = np.float32(1.0 / POINTS)
_BLACK = (_ZERO, _ZERO, _ZERO)
_LEAST = np.float32(1e-5)
_TINY = np.float32(1e-12)
_LEAST_ALBEDO = np.float32(0.1)
_LEAST_LEFT = np.float32(0.25)  # of a lobe's light, in the choice of a lobe: for lobes most of whose light is reflected back
_FIXED = np.float32(2.0**24)
_SHIFT = np.uint32(16)
_LOW = np.uint32(0xFFFF)
_STEP = np.float32(2.0**-16)
_SALT = np.uint32(0x9E3779B9)
# Steps of the lattice: even in the first dimension, else powers of the reciprocal of the root of x**6 = x + 1 (Roberts 2018).
_STEPS = tuple(np.float32(s) for s in (1.0 / POINTS, 0.7780896, 0.6054234, 0.4710737, 0.3665376, 0.2851991))


class Fibre(NamedTuple):
    """A fibre's parameters, and where a ray meets its cross-section. Vectors are given in the axes of the ellipse."""

    beckmann: Any  # see facets.py
    alpha: float
    roughness: float
    ior: float
    aspect: float  # minor radius
    tilt: tuple[float, float]  # sine and cosine of the scales' angle
    sigma: tuple[float, float, float]  # absorption per major radius, rgb
    shares: tuple[float, float, float]  # factors of R, TT and TRT
    point: tuple[float, float]  # where the ray enters, on the unit circle: the minor axis is divided by `aspect`
    normal: tuple[float, float, float]
    facet: tuple[float, float, float]  # the mean normal of the microfacets: the normal, tilted as the scales are


class Exit(NamedTuple):
    """The point where a ray inside the fibre meets its surface, and the light that it may refract out there."""

    towards: tuple[float, float, float]  # unit, back along the ray
    normal: tuple[float, float, float]  # inwards
    facet: tuple[float, float, float]
    light: tuple[float, float, float]  # that of wi over what leaves here, rgb
    choice: float  # the weight of this lobe in the choice of one


class Inside(NamedTuple):
    """The lobes of one path inside the fibre, through one point of the lattice, and of R."""

    reflected: float  # weight of R in the choice of a lobe
    once: Exit  # TT
    twice: Exit  # TRT
    rest: tuple[float, float, float]  # light of the residual lobe


@device
def _to_axes(m, w):
    """Returns a local direction in the axes of the ellipse."""
    s, c = m[rows.HUANG_NORMAL], m[rows.HUANG_NORMAL + 1]
    return w[1] * c + w[2] * s, w[0], w[2] * c - w[1] * s


@device
def _from_axes(m, w):
    """Returns a direction given in the axes of the ellipse in the local frame."""
    s, c = m[rows.HUANG_NORMAL], m[rows.HUANG_NORMAL + 1]
    return w[1], w[0] * c - w[2] * s, w[0] * s + w[2] * c


@device
def _fibre(beckmann, m):
    """Returns the Fibre at a hit."""
    s, c = m[rows.HUANG_NORMAL], m[rows.HUANG_NORMAL + 1]
    aspect = m[rows.HUANG_ASPECT]
    tilt = m[rows.HAIR_TILT], m[rows.HAIR_TILT + 1]
    scale = _ONE / math.sqrt(s * s + aspect * aspect * c * c)
    shares = m[rows.HUANG_SHARES], m[rows.HUANG_SHARES + 1], m[rows.HUANG_SHARES + 2]
    point = s * scale, aspect * c * scale
    facet = s * tilt[1], tilt[0], c * tilt[1]
    where = point, (s, _ZERO, c), facet
    look = m[rows.ALPHA_Y], m[rows.ROUGHNESS], m[rows.IOR], aspect, tilt
    return Fibre(beckmann, *look, absorption_of(m), shares, *where)


@device
def _sine(cosine):
    return math.sqrt(max(_ONE - cosine * cosine, _ZERO))


@device
def _lambda(fibre, cosine):
    """Returns Smith's Lambda for a direction at an angle to the mean normal of microfacets."""
    return facet_lambda(fibre.beckmann, (_sine(cosine), _ZERO, cosine), fibre.alpha, fibre.alpha)


@device
def _shadowing(fibre, cosine_o, cosine_i):
    """Returns G2 / G1 for visible normals: the share of light from a facet that others do not shadow."""
    masking = _ONE + _lambda(fibre, cosine_o)
    return masking / (masking + _lambda(fibre, cosine_i))


@device
def _visible_density(fibre, facet, w, h):
    """Returns the pdf of `_visible_normal`, per steradian of h."""
    cosine, z = vec.dot(w, facet), vec.dot(h, facet)
    density = facet_density(fibre.beckmann, (_sine(z), _ZERO, z), fibre.alpha, fibre.alpha)
    return max(vec.dot(w, h), _ZERO) * density / ((_ONE + _lambda(fibre, cosine)) * cosine)


@device
def _visible_normal(fibre, facet, w, u):
    """Samples the normal of a microfacet that is visible from w, about the mean normal `facet`."""
    s, t = vec.basis(facet)
    h = sample_visible_facet(fibre.beckmann, vec.to_local(s, t, facet, w), fibre.alpha, fibre.alpha, u)
    return vec.to_world(s, t, facet, h)


@device
def _compensation(fibre, cosine, eta):
    """Returns the factor that makes up for scattering among microfacets."""
    return _ONE / max(glass_albedo(fibre.beckmann, cosine, fibre.roughness, eta), _LEAST_ALBEDO)


@device
def _refracted(w, h, cosine, cosine_t, eta):
    """Returns the refracted direction of light from w, a unit vector away from the boundary, at a facet h.

    eta: index beyond the boundary over index on the side of w. cosine, cosine_t: of the angles to h.
    """
    inverse = _ONE / eta
    return vec.normalize(vec.sub(vec.scale(h, cosine * inverse - cosine_t), vec.scale(w, inverse)))


@device
def _sees(w, normal, facet):
    """Returns True if a direction is above the surface and its tilted scales."""
    return vec.dot(w, normal) > _LEAST and vec.dot(w, facet) > _LEAST


@device
def _crossed(fibre, point, w):
    """Returns (length, point) of the ray w from a point of the ellipse to the next one; the length is 0 if it leads outwards."""
    x, z = w[0], w[2] / fibre.aspect
    square = x * x + z * z
    if not square > _TINY:
        return _ZERO, point
    length = -_TWO * (point[0] * x + point[1] * z) / square
    x, z = point[0] + length * x, point[1] + length * z
    scale = _ONE / math.sqrt(x * x + z * z)
    return max(length, _ZERO), (x * scale, z * scale)


@device
def _inner_normals(fibre, point):
    """Returns (normal, mean normal of the facets) at a point of the ellipse, both inwards."""
    x, z = fibre.aspect * point[0], point[1]
    scale = -_ONE / math.sqrt(x * x + z * z)
    x, z = x * scale, z * scale
    sine, cosine = fibre.tilt
    return (x, _ZERO, z), (x * cosine, -sine, z * cosine)


@device
def _absorbed(fibre, length):
    s = fibre.sigma
    return exp(-s[0] * length), exp(-s[1] * length), exp(-s[2] * length)


@device
def _left_later(light, loss, reflected, passed):
    """Returns the light that leaves the fibre after further internal reflections, rgb.

    light: that arrives at this boundary, rgb. loss: transmittance of one crossing, rgb. reflected: reflectance here. passed: mean
    transmittance of the boundaries.
    """
    kept = _ONE - passed
    return (
        light[0] * reflected * loss[0] * passed / max(_ONE - loss[0] * kept, _LEAST),
        light[1] * reflected * loss[1] * passed / max(_ONE - loss[1] * kept, _LEAST),
        light[2] * reflected * loss[2] * passed / max(_ONE - loss[2] * kept, _LEAST),
    )


@device
def _nowhere(towards):
    return Exit(towards, towards, towards, _BLACK, _ZERO)


@device
def _choice(light, reflectance):
    return vec.luminance(light) * max(_ONE - reflectance, _LEAST_LEFT)


@device
def _inside(fibre, o, u):
    """Returns the lobes of the path whose microfacets are given by six numbers u. o: unit, towards the viewer."""
    none = _nowhere(o)
    outer = _compensation(fibre, vec.dot(o, fibre.facet), fibre.ior)
    h = _visible_normal(fibre, fibre.facet, o, (u[0], u[1]))
    cosine = vec.dot(o, h)
    reflectance, cosine_t = fresnel_dielectric(cosine, fibre.ior)
    reflected = fibre.shares[0] * reflectance * outer
    inner = _refracted(o, h, cosine, cosine_t, fibre.ior)
    back = vec.neg(inner)
    length, point = _crossed(fibre, fibre.point, inner)
    normal, facet = _inner_normals(fibre, point)
    if not (cosine > _ZERO and length > _ZERO and _sees(back, fibre.normal, fibre.facet) and _sees(back, normal, facet)):
        return Inside(reflected, none, none, _BLACK)
    left = _absorbed(fibre, length)
    entered = (_ONE - reflectance) * outer * _shadowing(fibre, vec.dot(o, fibre.facet), vec.dot(back, fibre.facet))
    eta = _ONE / fibre.ior
    light = vec.scale(left, entered * _compensation(fibre, vec.dot(back, facet), eta))
    h = _visible_normal(fibre, facet, back, (u[2], u[3]))
    cosine = vec.dot(back, h)
    reflectance, _ = fresnel_dielectric(cosine, eta)
    through = vec.scale(light, fibre.shares[1])
    once = Exit(back, normal, facet, through, _choice(through, reflectance))
    # The second reflection.
    inner = vec.sub(vec.scale(h, _TWO * cosine), back)
    if not (cosine > _ZERO and _sees(inner, normal, facet)):
        return Inside(reflected, once, none, _BLACK)
    light = vec.scale(light, reflectance * fibre.shares[2] * _shadowing(fibre, vec.dot(back, facet), vec.dot(inner, facet)))
    back = vec.neg(inner)
    length, point = _crossed(fibre, point, inner)
    normal, facet = _inner_normals(fibre, point)
    if not (length > _ZERO and _sees(back, normal, facet)):
        return Inside(reflected, once, none, _BLACK)
    again = _absorbed(fibre, length)
    light = vec.mul(light, again)
    h = _visible_normal(fibre, facet, back, (u[4], u[5]))
    cosine = vec.dot(back, h)
    reflectance_3, _ = fresnel_dielectric(cosine, eta)
    inner = vec.sub(vec.scale(h, _TWO * cosine), back)
    through = vec.scale(light, _compensation(fibre, vec.dot(back, facet), eta))
    twice = Exit(back, normal, facet, through, _choice(through, reflectance_3))
    loss = math.sqrt(left[0] * again[0]), math.sqrt(left[1] * again[1]), math.sqrt(left[2] * again[2])
    passed = max(_ONE - _HALF * (reflectance + reflectance_3), _LEAST)
    if not _sees(inner, normal, facet):
        return Inside(reflected, once, twice, _BLACK)
    reflectance_3 *= _shadowing(fibre, vec.dot(back, facet), vec.dot(inner, facet))
    return Inside(reflected, once, twice, _left_later(through, loss, reflectance_3, passed))


@device
def _total(path):
    """Returns the sum of the weights in the choice of a lobe, above 0."""
    return max(path.reflected + path.once.choice + path.twice.choice + vec.luminance(path.rest), _TINY)


@device
def _shifts(wo):
    """Returns six pseudorandom numbers, 0 ... 1, that depend on the direction alone."""
    x, y, z = u32(np.int64(wo[0] * _FIXED)), u32(np.int64(wo[1] * _FIXED)), u32(np.int64(wo[2] * _FIXED))
    a, b, c, _ = hash4(x, y, z, _SALT)
    return _fraction(a >> _SHIFT), _fraction(a), _fraction(b >> _SHIFT), _fraction(b), _fraction(c >> _SHIFT), _fraction(c)


@device
def _fraction(x):
    return to_float(u32(u32(x) & _LOW)) * _STEP


@device
def _lattice(shifts, k):
    """Returns the six coordinates of point k of the lattice."""
    return (
        _wrapped(shifts[0] + _STEPS[0] * k),
        _wrapped(shifts[1] + _STEPS[1] * k),
        _wrapped(shifts[2] + _STEPS[2] * k),
        _wrapped(shifts[3] + _STEPS[3] * k),
        _wrapped(shifts[4] + _STEPS[4] * k),
        _wrapped(shifts[5] + _STEPS[5] * k),
    )


@device
def _wrapped(x):
    """Returns the fraction of a number above 0."""
    return x - np.float32(np.int32(x))


@device
def _eval_reflection(fibre, o, i):
    """Returns (f |cos|, pdf) of R."""
    if not _sees(i, fibre.normal, fibre.facet):
        return _ZERO, _ZERO
    h = vec.normalize(vec.add(o, i))
    cosine = vec.dot(o, h)
    if not cosine > _ZERO:
        return _ZERO, _ZERO
    pdf = _visible_density(fibre, fibre.facet, o, h) / (_FOUR * cosine)
    reflectance, _ = fresnel_dielectric(cosine, fibre.ior)
    cosine_o = vec.dot(o, fibre.facet)
    factor = fibre.shares[0] * reflectance * _compensation(fibre, cosine_o, fibre.ior)
    return pdf * factor * _shadowing(fibre, cosine_o, vec.dot(i, fibre.facet)), pdf


@device
def _eval_exit(fibre, leaves, i):
    """Returns (f |cos|, pdf) of light that is refracted out of the fibre to i, for light 1 at the boundary."""
    w, facet = leaves.towards, leaves.facet
    outside = vec.neg(i)
    if not _sees(outside, leaves.normal, facet):
        return _ZERO, _ZERO
    eta = _ONE / fibre.ior
    h = vec.add(w, vec.scale(i, eta))
    square = vec.dot(h, h)
    if not square > _TINY:
        return _ZERO, _ZERO
    h = vec.scale(h, math.copysign(_ONE, vec.dot(h, facet)) / math.sqrt(square))
    cosine, cosine_i = vec.dot(w, h), vec.dot(i, h)
    if not (cosine > _ZERO and cosine_i < _ZERO):
        return _ZERO, _ZERO
    reflectance, _ = fresnel_dielectric(cosine, eta)
    denominator = cosine_i + cosine / eta
    pdf = _visible_density(fibre, facet, w, h) * -cosine_i / max(denominator * denominator, _TINY)
    return pdf * (_ONE - reflectance) * _shadowing(fibre, vec.dot(w, facet), vec.dot(outside, facet)), pdf


@device
def _eval_rest(fibre, o, i):
    """Returns the residual lobe's f |cos| for light 1, which is its pdf."""
    cosine_o, cosine_i = math.sqrt(o[0] * o[0] + o[2] * o[2]), math.sqrt(i[0] * i[0] + i[2] * i[2])
    return eval_longitudinal(_FOUR * fibre.alpha, o[1], cosine_o, i[1], cosine_i) * _INV_2PI


@subroutine
def eval_and_pdf_huang(beckmann, m, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions. beckmann: see facets.py."""
    never_inline()
    fibre = _fibre(beckmann, m)
    o, i = _to_axes(m, wo), _to_axes(m, wi)
    if not _sees(o, fibre.normal, fibre.facet):
        return _BLACK, _ZERO
    shifts = _shifts(wo)
    reflected, density = _eval_reflection(fibre, o, i)
    f, rest, pdf, rest_pdf = _BLACK, _BLACK, _ZERO, _ZERO
    for k in range(POINTS):
        path = _inside(fibre, o, _lattice(shifts, np.float32(k)))
        scale = _ONE / _total(path)
        pdf += scale * path.reflected * density
        if path.once.choice > _ZERO:
            value, chance = _eval_exit(fibre, path.once, i)
            f = vec.add(f, vec.scale(path.once.light, value))
            pdf += scale * path.once.choice * chance
        if path.twice.choice > _ZERO:
            value, chance = _eval_exit(fibre, path.twice, i)
            f = vec.add(f, vec.scale(path.twice.light, value))
            pdf += scale * path.twice.choice * chance
        rest = vec.add(rest, path.rest)
        rest_pdf += scale * vec.luminance(path.rest)
    spread = _eval_rest(fibre, o, i)
    f = vec.scale(vec.add(f, vec.scale(rest, spread)), _SHARE)
    return (f[0] + reflected, f[1] + reflected, f[2] + reflected), (pdf + rest_pdf * spread) * _SHARE


@device
def _sample_exit(fibre, leaves, u):
    """Samples a direction, in the axes of the ellipse, into which light leaves the fibre; zeros if it is reflected."""
    eta = _ONE / fibre.ior
    h = _visible_normal(fibre, leaves.facet, leaves.towards, u)
    cosine = vec.dot(leaves.towards, h)
    _, cosine_t = fresnel_dielectric(cosine, eta)
    if not cosine_t > _ZERO:
        return _BLACK
    i = _refracted(leaves.towards, h, cosine, cosine_t, eta)
    return i if _sees(vec.neg(i), leaves.normal, leaves.facet) else _BLACK


@device
def _sample_lobe(fibre, o, shifts, choose, u):
    """Samples a direction in the axes of the ellipse; returns zeros where nothing is scattered."""
    at = choose * np.float32(POINTS)
    k = min(np.float32(np.int32(at)), np.float32(POINTS - 1))
    path = _inside(fibre, o, _lattice(shifts, k))
    at = (at - k) * _total(path)
    if at < path.reflected:
        h = _visible_normal(fibre, fibre.facet, o, u)
        i = vec.sub(vec.scale(h, _TWO * vec.dot(o, h)), o)
        return i if _sees(i, fibre.normal, fibre.facet) else _BLACK
    at -= path.reflected
    if at < path.once.choice:
        return _sample_exit(fibre, path.once, u)
    at -= path.once.choice
    if at < path.twice.choice:
        return _sample_exit(fibre, path.twice, u)
    rest = vec.luminance(path.rest)
    if not rest > _ZERO:
        return _BLACK
    cosine_o = math.sqrt(o[0] * o[0] + o[2] * o[2])
    along = sample_longitudinal(_FOUR * fibre.alpha, o[1], cosine_o, u[0], min((at - path.twice.choice) / rest, _ONE))
    sine, cosine = sincos_turns(u[1])
    across = math.sqrt(max(_ONE - along * along, _ZERO))
    return across * sine, along, across * cosine


@subroutine
def sample_huang(beckmann, m, wo, choose, u):
    """Samples a local direction; returns (wi, weight, pdf per steradian). beckmann: see facets.py.

    choose: selects a point of the lattice and a lobe; what remains of it is a further random number.
    """
    fibre = _fibre(beckmann, m)
    o = _to_axes(m, wo)
    if not _sees(o, fibre.normal, fibre.facet):
        return (_ZERO, _ZERO, _ONE), _BLACK, _ZERO
    i = _sample_lobe(fibre, o, _shifts(wo), choose, u)
    if not vec.dot(i, i) > _ZERO:
        return (_ZERO, _ZERO, _ONE), _BLACK, _ZERO
    wi = _from_axes(m, i)
    f, pdf = eval_and_pdf_huang(beckmann, m, wo, wi)
    if not pdf > _ZERO:
        return wi, _BLACK, _ZERO
    return wi, vec.scale(f, _ONE / pdf), pdf
