"""How a path finds light: MIS weights, each strategy alone to compare it with, and two mistakes to show what they do."""

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
_LEAST_PDF, _MOST_PDF = np.float32(1e-18), np.float32(1e18)  # whose squares float32 still holds
_LEFT_TO_LIGHTS = np.float32(-1.0)  # in a density's place: light sampling alone counts what the direction meets
_CUTOFF = np.float32(1000.0)
_FARTHEST = np.float32(1e30)  # squared: beyond lies the environment, to which no distance is meant


@device
def power_heuristic(a, b):
    """The weight of a sample whose own density is a and the other strategy's b (Veach 1997): with b's, they sum to 1.

    a > 0."""
    a = min(max(a, _LEAST_PDF), _MOST_PDF)
    b = min(b, _MOST_PDF)
    return a * a / (a * a + b * b)


@device
def heuristic_weight(heuristic, a, b):
    """As `power_heuristic`, by whichever heuristic is asked for; balance is a / (a + b)."""
    if heuristic == BALANCE:
        a = min(max(a, _LEAST_PDF), _MOST_PDF)
        return a / (a + min(b, _MOST_PDF))
    return power_heuristic(a, b)


@device
def share_of_light(options, light_pdf, scatter_pdf, alone):
    """The weight of a light's sample under any strategy. scatter_pdf: times the number of directions that would have found it;
    alone: whether only light sampling finds it.
    """
    if alone or options.sampling == LIGHT:
        return _ONE
    return heuristic_weight(options.heuristic, light_pdf, scatter_pdf) if options.sampling == MIS else _ZERO


@subroutine
def _uniform_bounce(material, wo, choose, u):
    """A direction that does not ask what the material does with it: (wi, weight, radiance scale).

    Uniform over the hemisphere; over the sphere where light may pass. Single directions, which no such sample would find, are
    then taken from the material by the toss of a coin.
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
    """As `sample_material`, of the strategy: its pdf is what the next vertex's light is weighed with.

    0: it counts fully; less than 0: not at all, as light sampling has counted it.
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
    """What other renderers' errors make of a light at b seen from a: a factor. The environment keeps its 1.

    LIGHT_CUTOFF drops what is farther than sqrt(1000), ATTENUATION multiplies radiance, which has no distance, by 1/d^2.
    """
    way = vec.sub(b, a)
    square = vec.dot(way, way)
    if square > _FARTHEST:
        return _ONE
    if mistake == ATTENUATION:
        return _ONE / square
    return _ZERO if square > _CUTOFF else _ONE
