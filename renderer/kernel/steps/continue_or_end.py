"""Decides whether a path continues: limits on its length, and Russian roulette for paths with a small expected contribution.

Arvo & Kirk, "Particle Transport and Image Synthesis", 1990. The throughput is compared with the first vertex's weight, which
determines the pixel's brightness: paths from a green wall matter as much to its pixels as paths from a white wall to its own. A
path survives with certainty while its throughput is at least five sevenths of that weight: most of its cost is already spent, so
earlier termination would save little and add much noise.

The throughput that counts is the one that the path would have if the BSDF alone had sampled its directions. A direction that is
aimed at light has a high density and a low weight, so roulette by the real throughput would end the path just before the light
(Vorba & Krivanek, "Adjoint-Driven Russian Roulette and Splitting in Light Transport Simulation", 2016).
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.steps.depths import reached_limit
from renderer.kernel.steps.state import with_throughput
from renderer.settings import MAX_FLOOR
from renderer.wide.values import where, zero_like

__all__ = ["MAX_UNCOUNTED", "UNCOUNTED", "continue_or_end", "is_last", "roulette_weight_after", "survival"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_GENEROUS = np.float32(1.4)
_SHORT = np.float32(3.0)  # segments without roulette: a dark surface may still see a bright one
_LONG = np.float32(8.0)  # segments from which on survival is never certain, so that paths in white rooms end
_ON_SURFACES = np.float32(MAX_FLOOR)  # upper bound of survival from there on,
_IN_MEDIA = np.float32(
    0.99
)  # the same in media, where hundreds of white vertices in a row are common: 0.95 each would cause fireflies
_LEAST = np.float32(1e-12)
MAX_UNCOUNTED = 64  # limit of a path's segments that do not count: each has about an even chance of being the last at its vertex
_MAX_AGAIN = np.float32(MAX_UNCOUNTED)
UNCOUNTED = -2.0  # survival of a path that has left too many surfaces without a counted segment
_AGAIN = np.float32(UNCOUNTED)


@device
def is_last(path, counts, unlit, options):
    """Returns True if the path ends at its vertex because of a limit on its segments or bounces, or at an unlit material.

    counts: the path's depth counts by kind, from its Crossings. unlit: whether the material is unlit.
    """
    last = unlit | (path.depth + _ONE >= np.float32(options.max_depth))
    if options.has_depths:
        last = last | reached_limit(counts, options)
    return last


@device
def roulette_weight_after(roulette_weight, number, weight, eta2, unguided):
    """Returns the factor that relates a path's throughput to the first vertex's weight, updated after a vertex.

    number: count of earlier vertices, a float. weight: the vertex's weight, three channels. eta2: the radiance scale of a
    refraction, which must not affect survival. unguided: from BsdfSample.
    """
    return where(number == _ZERO, eta2 / max(vec.maximum(weight), _LEAST), roulette_weight * eta2 * unguided)


@device
def survival(throughput, roulette_weight, depth, options, is_surface):
    """Returns the survival probability of a path with `depth` segments, a float.

    roulette_weight: from `roulette_weight_after`. is_surface: False for a vertex in a medium.
    """
    most = where(depth < _LONG, _ONE, where(is_surface, _ON_SURFACES, _IN_MEDIA))
    by_throughput = min(max(_GENEROUS * vec.maximum(throughput) * roulette_weight, options.roulette_floor), most)
    chance = where(depth < _SHORT, _ONE, by_throughput)
    return where(options.roulette > _ZERO, options.roulette, chance)


@device
def continue_or_end(path, ray, u, is_surface, options):
    """Returns (PathState, survival probability) of a path after scattering. u: a random number in [0, 1).

    The second is negative if the path ends (UNCOUNTED if it has too many segments that do not count towards the depth), and 0 if
    its throughput is 0. Paths with NaN continue, so that the film can count them.
    """
    chance = survival(path.throughput, ray.roulette_weight, path.depth, options, is_surface)
    outcome = where(u >= chance, -chance, chance)
    again = path.number - path.depth > _MAX_AGAIN + np.float32(options.transmission_depth)
    outcome = where(again, _AGAIN, outcome)
    outcome = where(vec.maximum(path.throughput) <= _ZERO, zero_like(chance), outcome)
    return with_throughput(path, vec.scale(path.throughput, _ONE / chance)), outcome
