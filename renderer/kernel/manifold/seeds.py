"""Starts of walks: the choice of a direction towards a caster, with a positive density everywhere on it."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.manifold.brightness import SEEDS
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.sampling.warp import square_to_cone, square_to_sphere, square_to_triangle

__all__ = ["seed_direction"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_LISTED = np.float32(0.75)  # part of the directions
_PER_SEED = np.float32(SEEDS / 0.75)
_JITTER = np.float32(0.25)  # greatest tangent of the angle between a seed and the straight line to the lamp


@device
def seed_direction(scene, caster, p, line, is_aimed, bucket, u):
    """Returns a random unit direction from p towards a caster. u: three random numbers in [0, 1).

    bucket: from `seed_bucket`; if that is not -1, most directions are towards the places where its photons have left the caster.
    line: unit direction to the lamp, or to a place from which light of the wanted chain is known to come. is_aimed: whether a ray
    in that direction hits the caster first; half of the other directions are then near it.
    """
    choice = u[2]
    if bucket >= 0:
        if choice < _LISTED:
            photon = scene.caustics.seed[bucket, min(np.int32(choice * _PER_SEED), np.int32(SEEDS - 1))]
            return vec.normalize(vec.sub(row(scene.caustics.seed_place, photon, 3), p))
        choice = (choice - _LISTED) / (_ONE - _LISTED)
    if is_aimed:
        if choice < _HALF:
            sine, cosine = sincos_turns(u[1])
            radius = _JITTER * u[0] * u[0]
            s, t = vec.basis(line)
            return vec.normalize(vec.add(line, vec.add(vec.scale(s, radius * cosine), vec.scale(t, radius * sine))))
        choice = _TWO * choice - _ONE
    first, count, _, _ = row(scene.caustics.caster, caster, 4)
    if first >= len(scene.triangle):
        x, y, z, radius = row(scene.sphere, first - len(scene.triangle), 4)
        way = vec.sub((x, y, z), p)
        square = vec.dot(way, way)
        if square <= radius * radius:
            return square_to_sphere((u[0], u[1]))
        sine2 = radius * radius / square
        axis = vec.scale(way, _ONE / math.sqrt(square))
        s, t = vec.basis(axis)
        return vec.to_world(s, t, axis, square_to_cone((u[0], u[1]), sine2 / (_ONE + math.sqrt(max(_ZERO, _ONE - sine2)))))
    number = first + min(np.int32(choice * np.float32(count)), count - np.int32(1))
    i, j, k, _ = row(scene.triangle, number, 4)
    a, b, c = row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3)
    v, w = square_to_triangle((u[0], u[1]))
    q = vec.add(a, vec.add(vec.scale(vec.sub(b, a), v), vec.scale(vec.sub(c, a), w)))
    return vec.normalize(vec.sub(q, p))
