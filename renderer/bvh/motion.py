"""Rigid motion while the shutter is open: keys at equal time steps, and interpolation between them.

A key maps a point x of the body's space to place + turn * stretch * (x - point): `stretch` is a symmetric matrix, `turn` a unit
quaternion x y z w, and `point` the point of the body that moves in a straight line from key to key. Rotations are exact about any
axis. Between keys rotations are interpolated by slerp (Shoemake 1985), everything else linearly. Matrices are split into rotation
and stretch by polar decomposition: Shoemake & Duff, "Matrix Animation and Polar Decomposition" (1992).

Computed in double precision by additions, products and quotients only: the same bits on every host.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import KEY_COLUMNS
from renderer.jit import device

__all__ = ["ANGLE", "INVERSE_SINE", "KEY_COLUMNS", "PLACE", "POINT", "STRETCH", "TURN", "inverse_of", "step_at", "transform_at"]

POINT = 0  # three columns: in the body's space
PLACE = 3  # three: its world position
TURN = 6  # four: x y z w, with non-negative dot product with the previous key's
STRETCH = 10  # six: xx xy xz yy yz zz
ANGLE = 16  # half the angle to the next key's rotation, at most a right angle,
INVERSE_SINE = 17  # and 1 over its sine; 0 for nearly equal rotations, which are interpolated linearly


@device
def step_at(time, keys):
    """Returns (the index of the key before a time in 0 ... 1, the fraction of the step to the next key).

    keys: the number of keys, at least 2, at equal steps.
    """
    passed = np.float32(time) * np.float32(keys - 1)
    step = min(np.int64(passed), np.int64(keys - 2))
    return step, passed - np.float32(step)


@device
def _sine(x):
    """Returns the sine of an angle in 0 ... pi / 2, by its series, to within 6e-12."""
    y = x * x
    rest = 1.0 - y * (1.0 / 210.0)
    rest = 1.0 - y * (1.0 / 156.0) * rest
    rest = 1.0 - y * (1.0 / 110.0) * rest
    rest = 1.0 - y * (1.0 / 72.0) * rest
    rest = 1.0 - y * (1.0 / 42.0) * rest
    rest = 1.0 - y * (1.0 / 20.0) * rest
    rest = 1.0 - y * (1.0 / 6.0) * rest
    return x * rest


@device
def _interpolate(keys, k, column, share):
    a = keys[k, column]
    return a + share * (keys[k + 1, column] - a)


@device
def transform_at(keys, first, count, time):
    """Returns the matrix from a moving body's space to world space at a shutter time in 0 ... 1.

    The matrix has three rows, each with the translation last. keys: (R, KEY_COLUMNS) f64, in which this body's keys are the
    `count` rows from `first` on.
    """
    step, rest = step_at(time, count)
    k, share = first + step, np.float64(rest)
    before, after = 1.0 - share, share
    inverse = keys[k, INVERSE_SINE]
    if inverse > 0.0:
        before, after = _sine(before * keys[k, ANGLE]) * inverse, _sine(after * keys[k, ANGLE]) * inverse
    x = before * keys[k, TURN] + after * keys[k + 1, TURN]
    y = before * keys[k, TURN + 1] + after * keys[k + 1, TURN + 1]
    z = before * keys[k, TURN + 2] + after * keys[k + 1, TURN + 2]
    w = before * keys[k, TURN + 3] + after * keys[k + 1, TURN + 3]
    double = 2.0 / (x * x + y * y + z * z + w * w)
    r00, r01, r02 = 1.0 - double * (y * y + z * z), double * (x * y - z * w), double * (x * z + y * w)
    r10, r11, r12 = double * (x * y + z * w), 1.0 - double * (x * x + z * z), double * (y * z - x * w)
    r20, r21, r22 = double * (x * z - y * w), double * (y * z + x * w), 1.0 - double * (x * x + y * y)
    xx, xy, xz = (
        _interpolate(keys, k, STRETCH, share),
        _interpolate(keys, k, STRETCH + 1, share),
        _interpolate(keys, k, STRETCH + 2, share),
    )
    yy, yz, zz = (
        _interpolate(keys, k, STRETCH + 3, share),
        _interpolate(keys, k, STRETCH + 4, share),
        _interpolate(keys, k, STRETCH + 5, share),
    )
    a = r00 * xx + r01 * xy + r02 * xz, r00 * xy + r01 * yy + r02 * yz, r00 * xz + r01 * yz + r02 * zz
    b = r10 * xx + r11 * xy + r12 * xz, r10 * xy + r11 * yy + r12 * yz, r10 * xz + r11 * yz + r12 * zz
    c = r20 * xx + r21 * xy + r22 * xz, r20 * xy + r21 * yy + r22 * yz, r20 * xz + r21 * yz + r22 * zz
    px, py, pz = keys[k, POINT], keys[k, POINT + 1], keys[k, POINT + 2]
    tx = _interpolate(keys, k, PLACE, share) - (a[0] * px + a[1] * py + a[2] * pz)
    ty = _interpolate(keys, k, PLACE + 1, share) - (b[0] * px + b[1] * py + b[2] * pz)
    tz = _interpolate(keys, k, PLACE + 2, share) - (c[0] * px + c[1] * py + c[2] * pz)
    return (a[0], a[1], a[2], tx), (b[0], b[1], b[2], ty), (c[0], c[1], c[2], tz)


@device
def inverse_of(m):
    """Returns the rows of the inverse of a transform from `transform_at`."""
    a, b, c = m
    ax, ay, az = b[1] * c[2] - b[2] * c[1], a[2] * c[1] - a[1] * c[2], a[1] * b[2] - a[2] * b[1]
    bx, by, bz = b[2] * c[0] - b[0] * c[2], a[0] * c[2] - a[2] * c[0], a[2] * b[0] - a[0] * b[2]
    cx, cy, cz = b[0] * c[1] - b[1] * c[0], a[1] * c[0] - a[0] * c[1], a[0] * b[1] - a[1] * b[0]
    scale = 1.0 / (a[0] * ax + a[1] * bx + a[2] * cx)
    ax, ay, az, bx, by, bz, cx, cy, cz = (
        ax * scale,
        ay * scale,
        az * scale,
        bx * scale,
        by * scale,
        bz * scale,
        cx * scale,
        cy * scale,
        cz * scale,
    )
    return (
        (ax, ay, az, -(ax * a[3] + ay * b[3] + az * c[3])),
        (bx, by, bz, -(bx * a[3] + by * b[3] + bz * c[3])),
        (cx, cy, cz, -(cx * a[3] + cy * b[3] + cz * c[3])),
    )
