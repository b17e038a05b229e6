"""Transforms rays into the space of an instance."""

from __future__ import annotations

import numpy as np

from renderer.bvh.motion import inverse_of, transform_at
from renderer.jit import device, never_inline, subroutine

__all__ = ["ray_to_instance", "to_local"]


@device
def ray_to_instance(bvh, number, o, d, time):
    """Returns the ray in the space of an instance. time: shutter time, 0 ... 1; None if nothing moves."""
    if time is not None and len(bvh.instance_motion) > 0:
        first, keys = bvh.instance_motion[number, 0], bvh.instance_motion[number, 1]
        if keys > 0:
            return _ray_to_moving_instance(bvh.motion, first, keys, time, o, d)
    return to_local(bvh.to_local, number, o, d)


@subroutine
def _ray_to_moving_instance(motion, first, keys, time, o, d):
    never_inline()
    a, b, c = inverse_of(transform_at(motion, first, keys, time))
    ox, oy, oz = np.float64(o[0]), np.float64(o[1]), np.float64(o[2])
    dx, dy, dz = np.float64(d[0]), np.float64(d[1]), np.float64(d[2])
    return (
        (
            np.float32(a[0] * ox + a[1] * oy + a[2] * oz + a[3]),
            np.float32(b[0] * ox + b[1] * oy + b[2] * oz + b[3]),
            np.float32(c[0] * ox + c[1] * oy + c[2] * oz + c[3]),
        ),
        (
            np.float32(a[0] * dx + a[1] * dy + a[2] * dz),
            np.float32(b[0] * dx + b[1] * dy + b[2] * dz),
            np.float32(c[0] * dx + c[1] * dy + c[2] * dz),
        ),
    )


@device
def to_local(transform, number, o, d):
    """Returns the ray in a static instance's space. Its direction is not normalised, so t is the same as in world space.

    Computed in double precision and rounded once: the error of a ray's origin near the instance's surface is then no larger than
    with the same triangles in world space.
    """
    ox, oy, oz = np.float64(o[0]), np.float64(o[1]), np.float64(o[2])
    dx, dy, dz = np.float64(d[0]), np.float64(d[1]), np.float64(d[2])
    m = transform[number]
    return (
        (
            np.float32(m[0, 0] * ox + m[0, 1] * oy + m[0, 2] * oz + m[0, 3]),
            np.float32(m[1, 0] * ox + m[1, 1] * oy + m[1, 2] * oz + m[1, 3]),
            np.float32(m[2, 0] * ox + m[2, 1] * oy + m[2, 2] * oz + m[2, 3]),
        ),
        (
            np.float32(m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz),
            np.float32(m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz),
            np.float32(m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz),
        ),
    )
