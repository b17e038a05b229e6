"""The hair BSDF of Chiang et al., for fibres that are cylinders of a rough dielectric with tilted scales.

Light is reflected (R), transmitted (TT), reflected once inside (TRT), or leaves after more reflections, which one residual lobe
contains. Each lobe p scatters into

    A_p(h) M_p(theta_o, theta_i) N_p(phi_i - phi_o, h)

with a longitudinal term M_p around the cone of the mirror direction, an azimuthal term N_p, a logistic distribution trimmed to a
turn, and the attenuation A_p by Fresnel's equations and absorption. h, -1 ... 1, is the offset of the ray from the fibre's axis.

Sources: Chiang, Bitterli, Tappan & Burley, "A Practical and Controllable Hair and Fur Model for Production Path Tracing" (2016);
d'Eon et al., "An Energy-Conserving Hair Reflectance Model" (2011) for M_p; Pharr, "The Implementation of a Hair Scattering Model"
(2016).

In the local frame x is the fibre's direction from root to tip and z the normal of its round surface, so that h follows from wo.
wi may point to any side. Energy: without absorption, the integral of f |cos| over all wi is 1 for each wo.

A material is given as its parameter row m (renderer/arrays/rows.py) with textures looked up by `resolve` in
kernel/material/layers.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays import rows
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.polynomial import atan2, exp, log, sincos_turns
from renderer.wide.values import rint

__all__ = ["eval_and_pdf_hair", "sample_hair"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_PI = np.float32(math.pi)
_2PI = np.float32(2 * math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
_LEAST = np.float32(1e-6)
_LEAST_COLOR = np.float32(1e-4)
_MOST_CHOICE = np.float32(1.0 - 2.0**-24)
_BLACK = (_ZERO, _ZERO, _ZERO)
_NEAR = np.float32(3.75)
# Abramowitz & Stegun, "Handbook of Mathematical Functions", 9.8.1 and 9.8.2; relative error below 3e-7.
_I0_NEAR = tuple(np.float32(c) for c in (1.0, 3.5156229, 3.0899424, 1.2067492, 0.2659732, 0.0360768, 0.0045813))
_I0_FAR = tuple(
    np.float32(c)
    for c in (
        0.39894228, 0.01328592, 0.00225319, -0.00157565, 0.00916281, -0.02057706, 0.02635537, -0.01647633, 0.00392377,
    )
)  # fmt: skip


@device
def scaled_bessel_i0(x):
    """Returns exp(-x) I0(x), the modified Bessel function of the first kind, for x >= 0."""
    c = _I0_NEAR
    if x < _NEAR:
        t = (x / _NEAR) * (x / _NEAR)
        return exp(-x) * (c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))))))
    c = _I0_FAR
    t = _NEAR / x
    tail = c[4] + t * (c[5] + t * (c[6] + t * (c[7] + t * c[8])))
    return (c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * tail)))) / math.sqrt(x)


@device
def eval_longitudinal(variance, sine_o, cosine_o, sine_i, cosine_i):
    """Returns M_p per unit of sine: its integral over sine_i is 1.

    variance: v of the lobe. sine, cosine: of the inclinations theta to the plane across the fibre; cosines >= 0.
    """
    a = cosine_i * cosine_o / variance
    height = (cosine_i * cosine_o - sine_i * sine_o - _ONE) / variance
    return scaled_bessel_i0(a) * exp(height) / (variance * (_ONE - exp(-_TWO / variance)))


@device
def sample_longitudinal(variance, sine_o, cosine_o, u, v):
    """Returns the sine of theta_i, sampled with density M_p. u, v: 0 ... 1."""
    below = -variance * log(max(u + (_ONE - u) * exp(-_TWO / variance), _LEAST * _LEAST))  # 1 - cosine
    below = min(max(below, _ZERO), _TWO)
    sine = math.sqrt(below * (_TWO - below))
    turn = sincos_turns(v)[1]
    return min(max((below - _ONE) * sine_o + sine * turn * cosine_o, -_ONE), _ONE)


@device
def logistic_mass(scale):
    """Returns (cumulative logistic distribution at -pi, its mass from -pi to pi)."""
    first = _ONE / (_ONE + exp(_PI / scale))
    return first, _ONE - _TWO * first


@device
def eval_azimuthal(scale, x):
    """Returns the logistic density of angle x, wrapped and trimmed to -pi ... pi; its integral there is 1."""
    x = abs(x - _2PI * rint(x * _INV_2PI))
    fall = exp(-x / scale)
    return fall / (scale * (_ONE + fall) * (_ONE + fall) * logistic_mass(scale)[1])


@device
def sample_azimuthal(scale, u):
    """Returns an angle, -pi ... pi, sampled with density `eval_azimuthal`."""
    first, mass = logistic_mass(scale)
    y = min(max(first + u * mass, _LEAST * _LEAST), _MOST_CHOICE)
    return min(max(scale * log(y / (_ONE - y)), -_PI), _PI)


@device
def attenuations(ior, sigma, sine_o, cosine_o, cosine_gamma, sine_gamma):
    """Returns ((A_0, A_1, A_2, A_3), each rgb; the angle gamma_t of the ray inside, in the cross-section).

    sigma: absorption per radius, rgb. gamma: the angle of the ray to the normal, in the cross-section; its sine is h.
    """
    sine_t = sine_o / ior
    cosine_t = math.sqrt(max(_ONE - sine_t * sine_t, _LEAST))
    index = math.sqrt(max(ior * ior - sine_o * sine_o, _LEAST)) / max(cosine_o, _LEAST)
    sine_gamma_t = min(max(sine_gamma / index, -_ONE), _ONE)
    cosine_gamma_t = math.sqrt(max(_ONE - sine_gamma_t * sine_gamma_t, _ZERO))
    path = _TWO * cosine_gamma_t / cosine_t
    f = fresnel_dielectric(cosine_o * cosine_gamma, ior)[0]
    left = exp(-sigma[0] * path), exp(-sigma[1] * path), exp(-sigma[2] * path)
    once = vec.scale(left, (_ONE - f) * (_ONE - f))
    twice = vec.scale(vec.mul(once, left), f)
    rest = (
        twice[0] * f * left[0] / max(_ONE - f * left[0], _LEAST),
        twice[1] * f * left[1] / max(_ONE - f * left[1], _LEAST),
        twice[2] * f * left[2] / max(_ONE - f * left[2], _LEAST),
    )
    return ((f, f, f), once, twice, rest), atan2(sine_gamma_t, cosine_gamma_t)


@device
def tilted_cone(tilt, p, sine_o, cosine_o):
    """Returns (sine, cosine) of theta_o after the scales' tilt for lobe p: by -2 alpha for R, alpha for TT, 4 alpha for TRT.

    tilt: sine and cosine of alpha.
    """
    s, c = tilt
    s2, c2 = _TWO * s * c, c * c - s * s
    if p == 0:
        s, c = -s2, c2
    elif p == 2:
        s, c = _TWO * s2 * c2, c2 * c2 - s2 * s2
    elif p == 3:
        s, c = _ZERO, _ONE
    return sine_o * c + cosine_o * s, abs(cosine_o * c - sine_o * s)


@device
def lobe_variance(variance, p):
    """Returns v of lobe p: a quarter of R's for TT, four times R's for TRT and the rest."""
    return variance if p == 0 else variance / _FOUR if p == 1 else variance * _FOUR


@device
def absorption_of(m):
    """Returns the fibre's absorption per radius, rgb: that of its colour (Chiang et al. 2016, section 4.2) and its own."""
    scale = m[rows.HAIR_COLOR_SCALE]
    r = log(min(max(m[rows.BASE], _LEAST_COLOR), _ONE)) * scale
    g = log(min(max(m[rows.BASE + 1], _LEAST_COLOR), _ONE)) * scale
    b = log(min(max(m[rows.BASE + 2], _LEAST_COLOR), _ONE)) * scale
    return m[rows.ABSORPTION] + r * r, m[rows.ABSORPTION + 1] + g * g, m[rows.ABSORPTION + 2] + b * b


@device
def _incidence(wo):
    """Returns (sine and cosine of theta_o, cosine and sine of gamma_o, gamma_o) of a direction towards the viewer.

    gamma_o: the angle from the normal in the cross-section; its sine is h.
    """
    across = math.sqrt(wo[1] * wo[1] + wo[2] * wo[2])
    there = across > _LEAST
    cosine = max(wo[2], _ZERO) / across if there else _ONE
    sine = -wo[1] / across if there else _ZERO
    return min(max(wo[0], -_ONE), _ONE), across, cosine, sine, atan2(sine, cosine)


@device
def _total(lobes):
    """Returns the sum of the lobes' luminances, above 0: fibres of index 1 that absorb all light have none."""
    total = vec.luminance(lobes[0]) + vec.luminance(lobes[1]) + vec.luminance(lobes[2]) + vec.luminance(lobes[3])
    return max(total, _LEAST * _LEAST)


@device
def _net_turn(p, gamma_o, gamma_t):
    """Returns the azimuth by which lobe p turns a ray: phi_i - phi_o of a smooth fibre."""
    return _TWO * np.float32(p) * gamma_t - _TWO * gamma_o + np.float32(p) * _PI


@subroutine
def eval_and_pdf_hair(m, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions."""
    never_inline()
    sine_o, cosine_o, cosine_gamma, sine_gamma, gamma_o = _incidence(wo)
    lobes, gamma_t = attenuations(m[rows.IOR], absorption_of(m), sine_o, cosine_o, cosine_gamma, sine_gamma)
    total = _total(lobes)
    sine_i = wi[0]
    cosine_i = math.sqrt(wi[1] * wi[1] + wi[2] * wi[2])
    phi = atan2(-wi[1], wi[2]) - gamma_o
    f, pdf = _BLACK, _ZERO
    for p in range(4):
        tilt = m[rows.HAIR_TILT], m[rows.HAIR_TILT + 1]
        along_sine, along_cosine = tilted_cone(tilt, p, sine_o, cosine_o)
        density = eval_longitudinal(lobe_variance(m[rows.HAIR_VARIANCE], p), along_sine, along_cosine, sine_i, cosine_i)
        if p < 3:
            density *= eval_azimuthal(m[rows.HAIR_SCALE], phi - _net_turn(p, gamma_o, gamma_t))
        else:
            density *= _INV_2PI
        part = lobes[p]
        f = vec.add(f, vec.scale(part, density))
        pdf += vec.luminance(part) / total * density
    return f, pdf


@subroutine
def sample_hair(m, wo, choose, u):
    """Samples a local direction; returns (wi, weight, pdf per steradian).

    choose: selects a lobe, in proportion to the luminance of its attenuation; what remains of it is a further random number.
    """
    sine_o, cosine_o, cosine_gamma, sine_gamma, gamma_o = _incidence(wo)
    lobes, gamma_t = attenuations(m[rows.IOR], absorption_of(m), sine_o, cosine_o, cosine_gamma, sine_gamma)
    total = _total(lobes)
    p, at = 0, choose * total
    share = vec.luminance(lobes[0])
    while p < 3 and at >= share:
        at -= share
        p += 1
        share = vec.luminance(lobes[p])
    rest = min(at / max(share, _LEAST * _LEAST), _ONE)
    tilt = m[rows.HAIR_TILT], m[rows.HAIR_TILT + 1]
    along_sine, along_cosine = tilted_cone(tilt, p, sine_o, cosine_o)
    sine_i = sample_longitudinal(lobe_variance(m[rows.HAIR_VARIANCE], p), along_sine, along_cosine, u[0], rest)
    cosine_i = math.sqrt(max(_ONE - sine_i * sine_i, _ZERO))
    phi = u[1] * _2PI
    if p < 3:
        phi = _net_turn(p, gamma_o, gamma_t) + sample_azimuthal(m[rows.HAIR_SCALE], u[1])
    sine, cosine = sincos_turns((gamma_o + phi) * _INV_2PI)
    wi = sine_i, -cosine_i * sine, cosine_i * cosine
    f, pdf = eval_and_pdf_hair(m, wo, wi)
    if not pdf > _ZERO:
        return wi, _BLACK, _ZERO
    return wi, vec.scale(f, _ONE / pdf), pdf
