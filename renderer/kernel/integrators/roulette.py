"""Russian roulette: randomly terminates paths with a small expected contribution, for one path or for eight lanes.

Arvo & Kirk, "Particle Transport and Image Synthesis", 1990. The throughput is compared with the first vertex's weight, which
determines the pixel's brightness: paths of a green wall matter as much to its pixels as paths of a white wall to its own. A path
survives with certainty while it carries five sevenths of that: most of its cost is already spent, so earlier termination would
save little and add much noise.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.settings import MAX_FLOOR
from renderer.wide.values import where

__all__ = ["IN_MEDIA", "ON_SURFACES", "survival", "worth_after"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_GENEROUS = np.float32(1.4)
_SHORT = np.float32(3.0)  # segments without roulette: a dark surface may still see a bright one
_LONG = np.float32(8.0)  # segments from which on survival is never certain, so that paths in white rooms end
ON_SURFACES = np.float32(MAX_FLOOR)  # upper bound of survival from there on,
IN_MEDIA = np.float32(
    0.99
)  # where hundreds of white vertices in a row are nothing rare, and 0.95 each would make sparks of light
_LEAST = np.float32(1e-12)


@device
def worth_after(worth, number, weight, eta2):
    """Returns the factor that relates a path's throughput to the first vertex's weight, after a vertex.

    number: count of earlier vertices, a float; weight: the vertex's weight, three channels; eta2: the radiance scale of a
    refraction, which must not affect survival.
    """
    return where(number == _ZERO, eta2 / max(vec.maximum(weight), _LEAST), worth * eta2)


@device
def survival(throughput, worth, depth, options, most_of_long=ON_SURFACES):
    """Returns the survival probability of a path with `depth` segments, a float; worth: from `worth_after`.

    most_of_long: upper bound for long paths, ON_SURFACES or IN_MEDIA.
    """
    most = where(depth < _LONG, _ONE, most_of_long)
    by_throughput = min(max(_GENEROUS * vec.maximum(throughput) * worth, options.roulette_floor), most)
    chance = where(depth < _SHORT, _ONE, by_throughput)
    return where(options.roulette > _ZERO, options.roulette, chance)
