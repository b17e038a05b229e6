"""Russian roulette: paths end by chance where they can bring their pixel little (Arvo & Kirk, "Particle Transport and Image
Synthesis", 1990). Of one path, or of eight.

What a path carries is held against what its first vertex passed on, since that is by which its pixel is bright or dark: a green
wall's paths are no less worth to the wall's own pixels than a white wall's to its own. It goes on for certain as long as it
carries five sevenths of that: most of its way, and of what it costs, lies behind it, so that ending it sooner saves little and
adds much noise.
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
_SHORT = np.float32(3.0)  # segments that every path may have: what is dark there may still see what is bright
_LONG = np.float32(8.0)  # segments from which on nothing goes on for certain, that paths in white rooms end
ON_SURFACES = np.float32(MAX_FLOOR)  # the most chance that it has then,
IN_MEDIA = np.float32(
    0.99
)  # where hundreds of white vertices in a row are nothing rare, and 0.95 each would make sparks of light
_LEAST = np.float32(1e-12)


@device
def worth_after(worth, number, weight, eta2):
    """What a unit of a path's throughput is worth after a vertex: its part of what the first one passed on.

    number: how many vertices the path had before, a float; weight: what this one passes on, three channels; eta2: by so much
    radiance is thinner where the path goes on, which says nothing of what it is worth.
    """
    return where(number == _ZERO, eta2 / max(vec.maximum(weight), _LEAST), worth * eta2)


@device
def survival(throughput, worth, depth, options, most_of_long=ON_SURFACES):
    """The chance with which a path goes on that has `depth` segments behind it, a float; worth: of `worth_after`.

    most_of_long: by where its vertex is, ON_SURFACES or IN_MEDIA.
    """
    most = where(depth < _LONG, _ONE, most_of_long)
    by_throughput = min(max(_GENEROUS * vec.maximum(throughput) * worth, options.roulette_floor), most)
    chance = where(depth < _SHORT, _ONE, by_throughput)
    return where(options.roulette > _ZERO, options.roulette, chance)
