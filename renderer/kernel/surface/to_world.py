"""Transforms from instance space to world space, in float64, rounded once to float32."""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.motion import inverse_of, transform_at
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec

__all__ = ["normal_of_hit", "normal_to_world", "point_of_hit", "point_to_world", "tangent_to_world"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)


@subroutine
def normal_to_world(to_local, number, n):
    """Transforms a normal from instance to world space, without normalising it. Mirroring transforms do not change its side."""
    never_inline()
    m = to_local[number]
    x, y, z = np.float64(n[0]), np.float64(n[1]), np.float64(n[2])
    x, y, z = (
        m[0, 0] * x + m[1, 0] * y + m[2, 0] * z,
        m[0, 1] * x + m[1, 1] * y + m[2, 1] * z,
        m[0, 2] * x + m[1, 2] * y + m[2, 2] * z,
    )
    away = max(abs(x), max(abs(y), abs(z)))
    away = 1.0 / away if away > 0.0 else 0.0
    return np.float32(x * away), np.float32(y * away), np.float32(z * away)


@subroutine
def point_to_world(to_world, number, p, w):
    """Transforms a point (w = 1) or a direction (w = 0) from instance to world space."""
    never_inline()
    m = to_world[number]
    x, y, z, w = np.float64(p[0]), np.float64(p[1]), np.float64(p[2]), np.float64(w)
    return (
        np.float32(m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3] * w),
        np.float32(m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3] * w),
        np.float32(m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3] * w),
    )


@subroutine
def _moving_normal(motion, first, keys, time, n):
    """Transforms a normal from instance to world space, without normalising it, for a moving instance at a shutter time.

    motion: table of the instances' transforms at keys. first, keys: the instance's first row in it, and the number of its keys.
    """
    never_inline()
    a, b, c = inverse_of(transform_at(motion, first, keys, time))
    x, y, z = np.float64(n[0]), np.float64(n[1]), np.float64(n[2])
    x, y, z = a[0] * x + b[0] * y + c[0] * z, a[1] * x + b[1] * y + c[1] * z, a[2] * x + b[2] * y + c[2] * z
    away = max(abs(x), max(abs(y), abs(z)))
    away = 1.0 / away if away > 0.0 else 0.0
    return np.float32(x * away), np.float32(y * away), np.float32(z * away)


@subroutine
def _moving_point(motion, first, keys, time, p, w):
    """Transforms a point (w = 1) or a direction (w = 0) from instance to world space, for a moving instance at a shutter time.

    motion, first, keys: as for `_moving_normal`.
    """
    never_inline()
    a, b, c = transform_at(motion, first, keys, time)
    x, y, z, w = np.float64(p[0]), np.float64(p[1]), np.float64(p[2]), np.float64(w)
    return (
        np.float32(a[0] * x + a[1] * y + a[2] * z + a[3] * w),
        np.float32(b[0] * x + b[1] * y + b[2] * z + b[3] * w),
        np.float32(c[0] * x + c[1] * y + c[2] * z + c[3] * w),
    )


@device
def normal_of_hit(scene, hit, n):
    """Transforms a normal to world space for the instance that a Hit belongs to, at the Hit's shutter time; not normalised."""
    if hit.time is not None and len(scene.bvh.instance_motion) > 0:
        first, keys = scene.bvh.instance_motion[hit.instance, 0], scene.bvh.instance_motion[hit.instance, 1]
        if keys > 0:
            return _moving_normal(scene.bvh.motion, first, keys, hit.time, n)
    return normal_to_world(scene.bvh.to_local, hit.instance, n)


@device
def point_of_hit(scene, hit, p, w):
    """Transforms a point (w = 1) or a direction (w = 0) to world space for the instance of a Hit, at the Hit's shutter time."""
    if hit.time is not None and len(scene.bvh.instance_motion) > 0:
        first, keys = scene.bvh.instance_motion[hit.instance, 0], scene.bvh.instance_motion[hit.instance, 1]
        if keys > 0:
            return _moving_point(scene.bvh.motion, first, keys, hit.time, p, w)
    return point_to_world(scene.to_world, hit.instance, p, w)


@device
def tangent_to_world(scene, hit, tangent):
    """Transforms a tangent (xyz and the bitangent's sign) to world space; returns a unit tangent, or zeros if it vanishes.

    The bitangent's sign is flipped by mirroring transforms, as normals are not mirrored.
    """
    number = hit.instance
    d = point_of_hit(scene, hit, (tangent[0], tangent[1], tangent[2]), _ZERO)
    square = vec.dot(d, d)
    if not square > _ZERO:
        return _NO_TANGENT
    scale = _ONE / math.sqrt(square)
    m = scene.to_world[number]
    determinant = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return d[0] * scale, d[1] * scale, d[2] * scale, tangent[3] if determinant > 0.0 else -tangent[3]
