"""What the integrators share: what a path keeps of its first hit, and what happens to its light between two vertices."""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import ABSORBING, DISPERSIVE
from renderer.bvh.simd import load_int, store_int
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import absorption, disperse, is_lamp, is_transparent, opacity
from renderer.kernel.polynomial import exp
from renderer.kernel.sampling.sampler import draw1
from renderer.wide.values import any_of, where3

__all__ = [
    "COLOR_BLOCK",
    "FIRST_HIT_SLOTS",
    "PASSING_BLOCK",
    "TIME_BLOCK",
    "absorbed",
    "first_hit",
    "forget_first_hit",
    "keep_first_hit",
    "limited",
    "one_color",
    "reach",
]

_ZERO = np.float32(0.0)
_INDIRECT = np.float32(3)  # segments from which on light counts as indirect
PASSING_BLOCK = 1 << 16  # the first block of numbers for surfaces that may be passed; vertices use those below,
COLOR_BLOCK = 1 << 17  # and from here on those that spread colours
TIME_BLOCK = 1 << 18  # whose first number is the sample's time


# What the film wants of a path's first hit, in an array of the caller's: as values that every turn of the integrator's loop
# hands on, they would be in the way of all others.
FIRST_HIT_SLOTS = 12
_ALBEDO, _NORMAL, _POSITION, _DEPTH, _OBJECT, _MATERIAL = (np.uintp(k) for k in (0, 3, 6, 9, 10, 11))
_Y, _Z = np.uintp(1), np.uintp(2)


@device
def _keep(first, column, vector):
    first[column] = vector[0]
    first[column + _Y] = vector[1]
    first[column + _Z] = vector[2]


@device
def _kept(first, column):
    return first[column], first[column + _Y], first[column + _Z]


@device
def forget_first_hit(first):
    """Makes the array, (FIRST_HIT_SLOTS,) float32, that of a path which hits nothing: all 0."""
    for k in range(FIRST_HIT_SLOTS):
        first[k] = _ZERO


@device
def keep_first_hit(first, surface, albedo, normal, depth):
    """Writes down the first hit. normal: that it is shaded with, on the viewer's side; depth: its distance."""
    _keep(first, _ALBEDO, albedo)
    _keep(first, _NORMAL, normal)
    _keep(first, _POSITION, surface.point)
    first[_DEPTH] = depth
    store_int(first, _OBJECT, np.int32(1 + surface.object))
    store_int(first, _MATERIAL, np.int32(1 + surface.material))


@device
def first_hit(first):
    """What has been written: (albedo, normal, position, depth, 1 + object's number, 1 + material's number)."""
    ids = load_int(first, _OBJECT), load_int(first, _MATERIAL)
    return _kept(first, _ALBEDO), _kept(first, _NORMAL), _kept(first, _POSITION), first[_DEPTH], ids[0], ids[1]


@device
def _is_passed(scene, surface, stream, row, time):
    """Whether the path goes through the surface as if it were not there, which its alpha gives the chance of.

    row: how many surfaces the path has met before, passed or not: each has a chance of its own."""
    if not is_transparent(scene, surface.material):
        return False
    u = draw1(stream, np.uint32(PASSING_BLOCK + row))
    return u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)


@subroutine
def absorbed(throughput, a, start, end):
    """What is left of a throughput on the way from start to end, where a length of 1 takes exp(-a): Beer's law."""
    out_of_line()
    way = vec.sub(end, start)
    distance = math.sqrt(vec.dot(way, way))
    return throughput[0] * exp(-a[0] * distance), throughput[1] * exp(-a[1] * distance), throughput[2] * exp(-a[2] * distance)


@device
def _attenuated(scene, material, throughput, start, end):
    """What is left of the throughput on the way from start to end, through the inside of a material: Beer's law."""
    if scene.has.layers is None or scene.material_flags[material] & ABSORBING == 0:
        return throughput
    if scene.has.media is not None:
        return throughput  # flights have seen to it
    return absorbed(throughput, absorption(scene, material), start, end)


@device
def reach(scene, surface, path, options, stream, row, time):
    """What becomes of a path that meets a surface: (whether it passes it, its throughput there).

    row: how many surfaces it has met before; time: of the shutter, 0 ... 1; None where nothing moves.
    """
    through = is_lamp(scene, surface.material)
    if scene.has.textures is not None and options.transparent and not through:
        through = _is_passed(scene, surface, stream, row, time)
    throughput = path.throughput
    if not (surface.front or through):
        throughput = _attenuated(scene, surface.material, throughput, path.vertex, surface.point)
    return through, throughput


@device
def one_color(scene, surface, material, throughput, stream, segment):
    """As `disperse`, with a number of the segment's own."""
    if scene.has.layers is None or scene.material_flags[surface.material] & DISPERSIVE == 0:
        return material, throughput
    u = draw1(stream, np.uint32(np.uint32(COLOR_BLOCK) + segment))
    return disperse(scene, surface, material, throughput, u)


@device
def limited(light, segments, limit):
    """The light of a path of so many segments, if it is indirect with its greatest channel no greater than the limit, its hue
    kept; limit 0: none. Of one path, or of eight."""
    if limit > _ZERO:
        most = vec.maximum(light)
        bright = (segments >= _INDIRECT) & (most > limit)
        if any_of(bright):
            light = where3(bright, vec.scale(light, limit / most), light)
    return light
