"""What the integrators share: what a path brings home, and what happens to its light between two vertices."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.material import absorption, is_transparent, opacity
from renderer.kernel.polynomial import exp
from renderer.kernel.rows import ABSORBING
from renderer.kernel.sampler import uniform1

__all__ = ["COLOR_BLOCK", "PathResult", "attenuated", "is_passed", "limited"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
INDIRECT = 3  # segments from which on light counts as indirect
PASSING_BLOCK = 1 << 16  # the first block of numbers for surfaces that may be passed; vertices use those below,
COLOR_BLOCK = 1 << 17  # and from here on those that spread colours


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
def is_passed(scene, surface, options, pixel, sample, row):
    """Whether the path goes through the surface as if it were not there, which its alpha gives the chance of.

    row: how many surfaces the path has met before, passed or not: each has a chance of its own."""
    if not is_transparent(scene, surface.material):
        return False
    u = uniform1(options.sampler, options.seed, pixel, sample, np.uint32(PASSING_BLOCK + row))
    return u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3])


@subroutine
def _absorbed(throughput, a, start, end):
    out_of_line()
    way = vec.sub(end, start)
    distance = math.sqrt(vec.dot(way, way))
    return throughput[0] * exp(-a[0] * distance), throughput[1] * exp(-a[1] * distance), throughput[2] * exp(-a[2] * distance)


@device
def attenuated(scene, material, throughput, start, end):
    """What is left of the throughput on the way from start to end, through the inside of a material: Beer's law."""
    if scene.material_flags[material] & ABSORBING == 0:
        return throughput
    return _absorbed(throughput, absorption(scene, material), start, end)


@device
def limited(light, segments, limit):
    """The light of a path of so many segments, if it is indirect with its greatest channel no greater than the limit, its hue
    kept; limit 0: none."""
    if limit > _ZERO and segments >= INDIRECT:
        most = vec.maximum(light)
        if most > limit:
            return vec.scale(light, limit / most)
    return light
