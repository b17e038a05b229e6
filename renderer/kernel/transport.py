"""What the integrators share: what a path brings home, and what happens to its light between two vertices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.material import absorption, is_transparent, opacity
from renderer.kernel.options import ATTENUATION
from renderer.kernel.polynomial import exp
from renderer.kernel.rows import GLASS, LAYERED
from renderer.kernel.sampler import uniform4

__all__ = ["PathResult", "attenuated", "is_passed", "limited", "mistaken", "transmits"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_CUTOFF = np.float32(1000.0)
_FARTHEST = np.float32(1e30)  # squared: beyond lies the environment, to which no distance is meant
_PASSING = 1 << 16  # the first block of numbers for surfaces that may be passed; vertices use those below


class PathResult(NamedTuple):
    """What one path brought home: float32, colours in linear Rec.709."""

    radiance: tuple[float, float, float]
    albedo: tuple[float, float, float]  # of the first hit; 0 where nothing is hit
    normal: tuple[float, float, float]  # its shading normal, on the viewer's side
    depth: float  # its distance
    position: tuple[float, float, float]
    object: int  # 1 + its number; 0 where nothing is hit
    material: int  # likewise
    rays: int


@device
def is_passed(scene, surface, options, pixel, sample, passed):
    """Whether the path goes through the surface as if it were not there, which its alpha gives the chance of."""
    if not is_transparent(scene, surface.material):
        return False
    u = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(_PASSING + passed))[0]
    return u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3])


@subroutine
def _exp3(a, distance):
    return exp(-a[0] * distance), exp(-a[1] * distance), exp(-a[2] * distance)


@device
def attenuated(scene, material, throughput, distance):
    """What is left of the throughput after a way through the inside of a material: Beer's law."""
    a = absorption(scene, material)
    if vec.maximum(a) > _ZERO:
        return vec.mul(throughput, _exp3(a, distance))
    return throughput


@device
def limited(light, limit):
    """The light with its greatest channel no greater than the limit, its hue kept; limit 0: none."""
    if limit > _ZERO:
        most = vec.maximum(light)
        if most > limit:
            return vec.scale(light, limit / most)
    return light


@device
def transmits(material):
    """Whether light may pass from one side of the surface to the other."""
    return material.kind == GLASS or material.kind == LAYERED


@subroutine
def mistaken(mistake, square):
    """What other renderers' errors make of a light at the squared distance `square`: a factor. The environment keeps its 1.

    LIGHT_CUTOFF drops what is farther than sqrt(1000), ATTENUATION multiplies radiance, which has no distance, by 1/d^2.
    """
    if square > _FARTHEST:
        return _ONE
    if mistake == ATTENUATION:
        return _ONE / square
    return _ZERO if square > _CUTOFF else _ONE
