"""Looks up vertices, their normals, and spheres at a shutter time; those that move are interpolated between keys."""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.motion import step_at
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.wide.lanes import each_lane

__all__ = ["ball_at", "corner_normals_at", "corners_at"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@device
def _vertex(fixed, keys, count, i, time):
    """Returns row i of a vertex table at a shutter time.

    Only the table's last rows move, as in the BVH (renderer/bvh/traverse.py): they are interpolated between `keys`.
    """
    moving = len(keys) // count
    first = len(fixed) - moving
    number = np.int64(i)
    if number < first:
        return row(fixed, i, 3)
    step, share = step_at(time, count)
    a = row(keys, step * moving + number - first, 3)
    b = row(keys, step * moving + moving + number - first, 3)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@subroutine
def _three(fixed, keys, count, i, j, k, time):
    never_inline()
    return (
        _vertex(fixed, keys, count, i, time),
        _vertex(fixed, keys, count, j, time),
        _vertex(fixed, keys, count, k, time),
    )


@device
def corners_at(scene, i, j, k, time):
    """Returns the positions of the vertices i, j and k, in the space of their BVH.

    For one triangle or, if `time` is None, for eight lanes.
    """
    if time is not None and len(scene.key_position) > 0:
        return _three(scene.position, scene.key_position, scene.bvh.keyed_packets[1], i, j, k, time)
    return row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3)


@device
def _unit(n):
    square = vec.dot(n, n)
    return vec.scale(n, _ONE / math.sqrt(square)) if square > _ZERO else n


@device
def corner_normals_at(scene, i, j, k, time):
    """Returns the unit normals of the vertices i, j and k, for one triangle or, if `time` is None, for eight lanes."""
    if time is not None and len(scene.key_position) > 0:
        a, b, c = _three(scene.normal, scene.key_normal, scene.bvh.keyed_packets[1], i, j, k, time)
        return _unit(a), _unit(b), _unit(c)
    return row(scene.normal, i, 3), row(scene.normal, j, 3), row(scene.normal, k, 3)


@subroutine
def _ball(fixed, keys, count, number, time):
    never_inline()
    moving = len(keys) // count
    first = len(fixed) - moving
    i = np.int64(number)
    if i < first:
        return row(fixed, number, 4)
    step, share = step_at(time, count)
    a, b = row(keys, step * moving + i - first, 4), row(keys, step * moving + moving + i - first, 4)
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
        a[3] + share * (b[3] - a[3]),
    )


@device
def ball_at(scene, number, time):
    """Returns a sphere's (x, y, z, radius), for one sphere or for eight lanes."""
    if time is not None and len(scene.key_sphere) > 0:
        return each_lane(_ball, number == number, (scene.sphere, scene.key_sphere, scene.bvh.keyed_packets[1], number, time))
    return row(scene.sphere, number, 4)
