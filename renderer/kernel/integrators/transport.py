"""Functions shared by integrators: the first hit's record, and transport of light between two vertices."""

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
    "PASSING_BLOCKS",
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
_INDIRECT = np.float32(3)  # number of segments from which on light is indirect
PASSING_BLOCK = 1 << 16  # first random number block of transparent surfaces; vertices use lower ones,
PASSING_BLOCKS = np.uint32((1 << 16) - 1)  # mask of the surface's number: paths that pass through more use the same again
COLOR_BLOCK = 1 << 17  # first block of dispersive surfaces
TIME_BLOCK = 1 << 18  # block whose first number is the sample's shutter time


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
    """Clears the first-hit array, (FIRST_HIT_SLOTS,) float32: all 0, as for a path that hits nothing."""
    for k in range(FIRST_HIT_SLOTS):
        first[k] = _ZERO


@device
def keep_first_hit(first, surface, albedo, normal, depth):
    """Writes the first hit. normal: the shading normal on the viewer's side; depth: distance along the ray."""
    _keep(first, _ALBEDO, albedo)
    _keep(first, _NORMAL, normal)
    _keep(first, _POSITION, surface.point)
    first[_DEPTH] = depth
    store_int(first, _OBJECT, np.int32(1 + surface.object))
    store_int(first, _MATERIAL, np.int32(1 + surface.material))


@device
def first_hit(first):
    """Returns the recorded (albedo, normal, position, depth, 1 + object number, 1 + material number)."""
    ids = load_int(first, _OBJECT), load_int(first, _MATERIAL)
    return _kept(first, _ALBEDO), _kept(first, _NORMAL), _kept(first, _POSITION), first[_DEPTH], ids[0], ids[1]


@device
def _is_passed(scene, surface, stream, row, time):
    """Whether the path passes through the surface, chosen randomly by its alpha.

    row: number of surfaces hit before, passed or not; it selects the random number.
    """
    if not is_transparent(scene, surface.material):
        return False
    u = draw1(stream, np.uint32(PASSING_BLOCK + (np.uint32(row) & PASSING_BLOCKS)))
    return u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)


@subroutine
def absorbed(throughput, a, start, end):
    """Returns the throughput after absorption from start to end: Beer's law. a: absorption coefficient, rgb per unit length."""
    out_of_line()
    way = vec.sub(end, start)
    distance = math.sqrt(vec.dot(way, way))
    return throughput[0] * exp(-a[0] * distance), throughput[1] * exp(-a[1] * distance), throughput[2] * exp(-a[2] * distance)


@device
def _attenuated(scene, material, throughput, start, end):
    """Returns the throughput after absorption inside a material, from start to end: Beer's law."""
    if scene.has.layers is None or scene.material_flags[material] & ABSORBING == 0:
        return throughput
    if scene.has.media is not None:
        return throughput  # included in the free flights
    return absorbed(throughput, absorption(scene, material), start, end)


@device
def reach(scene, surface, path, options, stream, row, time):
    """Returns (whether the path passes through the surface that it hit, its throughput there).

    row: number of surfaces hit before; time: shutter time, 0 ... 1; None for a scene without motion.
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
    """Returns `disperse`, (material, throughput), with a random number of this segment."""
    if scene.has.layers is None or scene.material_flags[surface.material] & DISPERSIVE == 0:
        return material, throughput
    u = draw1(stream, np.uint32(np.uint32(COLOR_BLOCK) + segment))
    return disperse(scene, surface, material, throughput, u)


@device
def limited(light, segments, limit):
    """Returns the light of a path, clamped if it is indirect: scaled so that its largest channel is at most `limit`.

    segments: number of the path's segments; limit 0: no clamping. For one path or for eight lanes.
    """
    if limit > _ZERO:
        most = vec.maximum(light)
        bright = (segments >= _INDIRECT) & (most > limit)
        if any_of(bright):
            light = where3(bright, vec.scale(light, limit / most), light)
    return light
