"""Strategies to find light: MIS weights, single strategies for comparison, and two deliberate errors for demonstration."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import eval_material, is_specular, sample_material, transmits
from renderer.kernel.options import ATTENUATION, BALANCE, BSDF, LIGHT, MIS, UNIFORM
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.sampling.warp import square_to_sphere

__all__ = ["heuristic_weight", "mistaken", "power_heuristic", "share_of_light", "special_bounce"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_TWO_PI = np.float32(2.0 * math.pi)
_EIGHT_PI = np.float32(8.0 * math.pi)
_LEAST_PDF, _MOST_PDF = np.float32(1e-18), np.float32(1e18)  # bounds whose squares fit float32
_LEFT_TO_LIGHTS = np.float32(-1.0)  # in place of a pdf: the emission hit next is left to light sampling
_CUTOFF = np.float32(1000.0)
_FARTHEST = np.float32(1e30)  # squared; farther points are the environment


@device
def power_heuristic(a, b):
    """Returns the MIS weight of a sample with own density a > 0 and the other strategy's density b.

    Power heuristic with exponent 2 (Veach 1997).
    """
    a = min(max(a, _LEAST_PDF), _MOST_PDF)
    b = min(b, _MOST_PDF)
    return a * a / (a * a + b * b)


@device
def heuristic_weight(heuristic, a, b):
    """Returns the MIS weight by the selected heuristic: power, or balance, a / (a + b)."""
    if heuristic == BALANCE:
        a = min(max(a, _LEAST_PDF), _MOST_PDF)
        return a / (a + min(b, _MOST_PDF))
    return power_heuristic(a, b)


@device
def share_of_light(options, light_pdf, scatter_pdf, alone):
    """Returns the weight of a light sample under the selected strategy.

    scatter_pdf: density of BSDF sampling times the number of branches; alone: whether rays cannot hit the light.
    """
    if alone or options.sampling == LIGHT:
        return _ONE
    return heuristic_weight(options.heuristic, light_pdf, scatter_pdf) if options.sampling == MIS else _ZERO


@subroutine
def _uniform_bounce(material, wo, choose, u):
    """Samples a direction independently of the material: (wi, weight, radiance scale).

    Uniform over the hemisphere, or over the sphere where the material transmits; there, with probability 1/2, a discrete
    direction of the material is taken instead, since uniform sampling cannot find it.
    """
    out_of_line()
    both = transmits(material)
    if both:
        if choose < _HALF:
            wi, weight, pdf, thinned = sample_material(material, wo, _TWO * choose, u)
            return wi, vec.scale(weight, _TWO if pdf == _ZERO else _ZERO), thinned
        wi = square_to_sphere(u)
    else:
        radius = math.sqrt(u[0] * (_TWO - u[0]))
        sine, cosine = sincos_turns(u[1])
        wi = (radius * cosine, radius * sine, _ONE - u[0])
    f, _ = eval_material(material, wo, wi)
    return wi, vec.scale(f, _EIGHT_PI if both else _TWO_PI), _ONE


@device
def special_bounce(material, sampling, wo, choose, u):
    """Samples a direction by the selected strategy, as `sample_material`; its pdf determines the weight of light hit next.

    pdf 0: the light counts fully; negative: not at all, since light sampling has counted it.
    """
    if sampling == UNIFORM and not is_specular(material):
        wi, weight, thinned = _uniform_bounce(material, wo, choose, u)
        return wi, weight, _ZERO, thinned
    wi, weight, pdf, thinned = sample_material(material, wo, choose, u)
    if pdf > _ZERO:
        if sampling == LIGHT:
            pdf = _LEFT_TO_LIGHTS
        elif sampling == BSDF:
            pdf = _ZERO
    return wi, weight, pdf, thinned


@subroutine
def mistaken(mistake, a, b):
    """Returns the factor by which a deliberate error changes the light of point b at a; 1 for the environment.

    LIGHT_CUTOFF drops lights farther than sqrt(1000); ATTENUATION multiplies radiance by 1/d^2, although radiance is constant
    along a ray.
    """
    way = vec.sub(b, a)
    square = vec.dot(way, way)
    if square > _FARTHEST:
        return _ONE
    if mistake == ATTENUATION:
        return _ONE / square
    return _ZERO if square > _CUTOFF else _ONE
