"""Strategies to find light: MIS weights, single strategies for comparison, and two deliberate errors for demonstration."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.lineage.mixture import mixture_bounce
from renderer.kernel.material.material import eval_material, is_specular, sample_material
from renderer.kernel.options import ATTENUATION, BALANCE, BSDF, LIGHT, MIS, MIXTURE, NO_MISTAKE, UNIFORM
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.sampling.warp import square_to_sphere
from renderer.kernel.steps.mis import LEAST_PDF, MOST_PDF, power_heuristic
from renderer.kernel.steps.state import BsdfSample

__all__ = ["heuristic_weight", "mistake_factor", "sample_direction", "weigh_hit", "weigh_light"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_TWO_PI = np.float32(2.0 * math.pi)
_EIGHT_PI = np.float32(8.0 * math.pi)
_LEFT_TO_LIGHTS = np.float32(-1.0)  # in place of a pdf: emission hit next does not count, since light sampling adds it
_CUTOFF = np.float32(1000.0)
_FARTHEST = np.float32(1e30)  # squared distance; farther points are the environment


@device
def heuristic_weight(heuristic, a, b):
    """Returns the MIS weight of a sample with density a, where the other strategy has density b.

    heuristic: selects the power heuristic, or the balance heuristic, a / (a + b).
    """
    if heuristic == BALANCE:
        a = min(max(a, LEAST_PDF), MOST_PDF)
        return a / (a + min(b, MOST_PDF))
    return power_heuristic(a, b)


@device
def weigh_hit(options, ray, path, last, point, light_pdf):
    """Returns the weight of light that a path hits, under the selected MIS heuristic and deliberate error.

    The other arguments are as for `hit_weight` in steps/mis.py. point: the light's position; None for the environment, which no
    deliberate error changes.
    """
    weight = heuristic_weight(options.heuristic, ray.pdf, light_pdf) if ray.pdf > _ZERO else _ONE
    if point is not None and options.mistake != NO_MISTAKE and path.number > _ZERO:
        weight *= mistake_factor(options.mistake, last.point, point)
    return weight


@device
def weigh_light(options, light, scatter_pdf, branches, point):
    """Returns the weight of a light sample at `point` under the selected strategy and deliberate error.

    See `light_weight` in steps/mis.py.
    """
    weight = _ZERO
    if branches == _ZERO or options.sampling == LIGHT:
        weight = _ONE
    elif options.sampling == MIS:
        weight = heuristic_weight(options.heuristic, light.pdf, branches * scatter_pdf)
    if options.mistake != NO_MISTAKE:
        weight *= mistake_factor(options.mistake, point, light.end)
    return weight


@subroutine
def _uniform_bounce(material, wo, choose, u):
    """Samples a direction independently of the material: (wi, weight, radiance scale).

    The direction is uniform over the hemisphere, or over the sphere if the material transmits. For a transmitting material a
    discrete direction of the material is used with probability 1/2, since uniform sampling cannot find it.
    """
    never_inline()
    both = material.two_sided
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
def sample_direction(scene, vertex, options, choose, u):
    """Samples a direction by the selected strategy; returns a BsdfSample.

    Its pdf determines the weight of light that the ray hits next. pdf 0: that light has weight 1. Negative pdf: weight 0, since
    light sampling has added that light already.
    """
    material, wo, sampling = vertex.material, vertex.wo, options.sampling
    if sampling == MIXTURE and not is_specular(material):
        return mixture_bounce(scene, vertex.surface.point, vertex.frame, material, wo, choose, u)
    if sampling == UNIFORM and not is_specular(material):
        wi, weight, eta2 = _uniform_bounce(material, wo, choose, u)
        pdf = _ZERO
    else:
        wi, weight, pdf, eta2 = sample_material(material, wo, choose, u)
        if pdf > _ZERO:
            if sampling == LIGHT:
                pdf = _LEFT_TO_LIGHTS
            elif sampling == BSDF:
                pdf = _ZERO
    return BsdfSample(wi, weight, pdf, eta2, _ONE)


@subroutine
def mistake_factor(mistake, a, b):
    """Returns the factor by which a deliberate error changes the light of point b at a; 1 for the environment.

    LIGHT_CUTOFF omits lights farther than sqrt(1000); ATTENUATION multiplies radiance by 1/d^2, although radiance is constant
    along a ray.
    """
    way = vec.sub(b, a)
    square = vec.dot(way, way)
    if square > _FARTHEST:
        return _ONE
    if mistake == ATTENUATION:
        return _ONE / square
    return _ZERO if square > _CUTOFF else _ONE
