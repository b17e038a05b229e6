"""Photons, from which a guide is trained: paths from lights, and records of the flux that arrives at their vertices.

The path tracer for camera paths follows them, with a ray from a light in place of the camera's. A guide need not be exact, so the
differences between radiance and importance (refraction, bent normals) are left out. Light that arrives directly from a light is
not recorded, since light sampling finds it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device, entry, local_floats, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import FIRST_HIT_SLOTS
from renderer.kernel.backends.scalar.picture import trace_with
from renderer.kernel.guiding.pilot import record_photon
from renderer.kernel.sampling.sampler import draw4, pixel_key
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere, square_to_disk, square_to_sphere, square_to_triangle
from renderer.kernel.steps.random_blocks import draw_time
from renderer.kernel.steps.spawn_camera_ray import CameraRay
from renderer.kernel.steps.state import stream_of
from renderer.prune_absent_features import where_present
from renderer.reference import by_reference

__all__ = [
    "DISTANT",
    "EMITTER_COLUMNS",
    "EMITTER_EDGES",
    "EMITTER_KIND",
    "EMITTER_NORMAL",
    "EMITTER_PLACE",
    "EMITTER_SIDES",
    "PARALLELOGRAM",
    "SPHERE",
    "TRIANGLE",
    "Photons",
    "follow_photons",
]

# Columns of an emitter: its kind; a corner, centre or, of a distant light, the centre of a disk; two edges, or a radius; the
# normal of its front, or the direction to a distant light; and the number of sides that emit.
EMITTER_KIND, EMITTER_PLACE, EMITTER_EDGES, EMITTER_NORMAL, EMITTER_SIDES = 0, 1, 4, 10, 13
EMITTER_COLUMNS = 14
TRIANGLE, PARALLELOGRAM, SPHERE, DISTANT = range(4)

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_START = np.uint32(0)  # the block of the point from which a photon starts; the camera's of camera paths
_DIRECTION = np.uint32(1 << 19)  # the block of its direction
_OUTSIDE = np.uint32(0)
_OFFSET = np.float32(1e-4)  # of a photon's start from its light, relative to the point's largest coordinate


class Photons(NamedTuple):
    """The photons of one call: `count` photons from number `first` on. table, cdf: renderer/guiding/emitters.py."""

    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    table: np.ndarray
    cdf: np.ndarray


@device
def _vector(table, k, column):
    return table[k, column], table[k, column + 1], table[k, column + 2]


@subroutine
def _emit(table, k, u, v):
    """Returns (origin, unit direction) of a photon of emitter k. u, v: four random numbers each."""
    never_inline()
    kind, place = np.int64(table[k, EMITTER_KIND]), _vector(table, k, EMITTER_PLACE)
    normal, radius = _vector(table, k, EMITTER_NORMAL), table[k, EMITTER_EDGES]
    if kind == DISTANT:
        s, t = vec.basis(normal)
        x, y = square_to_disk((u[0], u[1]))
        return vec.add(place, vec.scale(vec.add(vec.scale(s, x), vec.scale(t, y)), radius)), vec.neg(normal)
    if kind == SPHERE:
        normal = square_to_sphere((u[0], u[1]))
        point = vec.add(place, vec.scale(normal, radius))
    else:
        a, b = u[0], u[1]
        if kind == TRIANGLE:
            a, b = square_to_triangle((a, b))
        first, second = _vector(table, k, EMITTER_EDGES), _vector(table, k, EMITTER_EDGES + 3)
        point = vec.add(place, vec.add(vec.scale(first, a), vec.scale(second, b)))
        if table[k, EMITTER_SIDES] > _ONE and v[2] < _HALF:
            normal = vec.neg(normal)
    s, t = vec.basis(normal)
    d = normal
    if kind != SPHERE or radius > _ZERO:
        d = vec.to_world(s, t, normal, square_to_cosine_hemisphere((v[0], v[1])))
    return vec.add(point, vec.scale(normal, _OFFSET * max(vec.magnitude(point), _OFFSET))), d


@device
def _chosen(cdf, u):
    """Returns the number of the emitter that the random number u chooses."""
    low, high = 0, len(cdf) - 1
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@subroutine
def _follow(scene, stack, options, photons, log, records):
    never_inline()
    first_hit = local_floats(FIRST_HIT_SLOTS)
    medium_stack = where_present(scene.has.media, _OUTSIDE)
    count = 0
    for number in range(photons.first, photons.first + photons.count):
        stream = stream_of(options, pixel_key(0, 0), np.uint32(number))
        u, v = draw4(stream, _START), draw4(stream, _DIRECTION)
        o, d = _emit(photons.table, _chosen(photons.cdf, np.float64(u[2])), u, v)
        time = where_present(scene.has.motion, draw_time(stream))
        ray = CameraRay(o, d, _ZERO, time, stream)
        trace_with(scene, stack, ray, medium_stack, options, log, first_hit, False)
        count = record_photon(log, records, count)
    return count


@entry
def follow_photons(scene, stack, options, photons, log, records):
    """Follows photons and writes the records of their flux; returns the number of records.

    Each photon carries the same power, of which a record holds the part that is left. The other arguments are as for
    `follow_pilot_paths`.
    """
    return _follow(by_reference(scene), stack, options, photons, log, records)
