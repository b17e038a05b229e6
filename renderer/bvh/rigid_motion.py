"""Computes the motion keys of moving bodies, in the layout described in renderer/bvh/motion.py.

Uses separate additions, products, quotients and roots, for all bodies at once, so the result has the same bits on every host.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.bvh.motion import ANGLE, INVERSE_SINE, KEY_COLUMNS, PLACE, POINT, STRETCH, TURN

__all__ = ["largest_rotation", "motion_keys", "polar"]

F64 = npt.NDArray[np.float64]

_ROUNDS = 24  # Newton iterations; scaled, ten suffice for a condition of 1e6
_MIN_ROTATION = 1e-12  # for a body that rotates by less than about 1e-3 a key, the origin moves straight
_SLACK = 1e-9
_TOLERANCE = 1e-9


def motion_keys(places: F64) -> F64:
    """Returns the motion keys (N, K, KEY_COLUMNS) of N bodies.

    places: (N, K, 3, 4), the bodies' transforms at K keys: an invertible matrix and a translation each.
    """
    turn, stretch = polar(places[:, :, :, :3])
    rotation = _quaternions(turn)
    angle, inverse = _half_angles(rotation)
    point = _straightest_points(places)
    keys = np.zeros((*places.shape[:2], KEY_COLUMNS))
    keys[:, :, POINT : POINT + 3] = point[:, None]
    keys[:, :, PLACE : PLACE + 3] = _product(places[:, :, :, :3], point[:, None, :, None])[..., 0] + places[:, :, :, 3]
    keys[:, :, TURN : TURN + 4] = rotation
    keys[:, :, STRETCH : STRETCH + 6] = stretch[:, :, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    keys[:, :-1, ANGLE] = angle
    keys[:, :-1, INVERSE_SINE] = inverse
    return keys


def largest_rotation(keys: F64) -> float:
    """Returns the largest angle, in radians, by which any body rotates from a key to the next. keys: from `motion_keys`."""
    return 2.0 * float(keys[:, :, ANGLE].max(initial=0.0))


def polar(matrix: F64) -> tuple[F64, F64]:
    """Returns the polar decomposition of invertible matrices: rotations and symmetric matrices, (..., 3, 3) each.

    Newton's iteration, scaled: Higham, "Computing the Polar Decomposition with Applications" (1986). Reflections are part of the
    symmetric matrix.
    """
    turn = matrix / _norm(matrix)[..., None, None]
    for _ in range(_ROUNDS):
        inverse = _inverse_transposed(turn)
        scale = np.sqrt(_norm(inverse) / _norm(turn))[..., None, None]
        turn = 0.5 * (scale * turn + inverse / scale)
    turn = np.where(_determinant(turn)[..., None, None] < 0, -turn, turn)
    stretch = _product(np.swapaxes(turn, -1, -2), matrix)
    return turn, 0.5 * (stretch + np.swapaxes(stretch, -1, -2))


def _product(outer: F64, inner: F64) -> F64:
    found: F64 = outer[..., :, 0, None] * inner[..., None, 0, :]
    for k in range(1, outer.shape[-1]):
        found = found + outer[..., :, k, None] * inner[..., None, k, :]
    return found


def _norm(m: F64) -> F64:
    square = m * m
    total: F64 = square[..., 0, 0]
    for i, j in list(np.ndindex(3, 3))[1:]:
        total = total + square[..., i, j]
    return np.sqrt(total)


def _cofactors(m: F64) -> F64:
    found = np.empty_like(m)
    for i, j in np.ndindex(3, 3):
        a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        found[..., i, j] = m[..., a, c] * m[..., b, d] - m[..., a, d] * m[..., b, c]
    return found


def _determinant(m: F64) -> F64:
    cofactors = _cofactors(m)
    found: F64 = (m[..., 0, 0] * cofactors[..., 0, 0] + m[..., 0, 1] * cofactors[..., 0, 1]) + m[..., 0, 2] * cofactors[..., 0, 2]
    return found


def _inverse_transposed(m: F64) -> F64:
    return _cofactors(m) / _determinant(m)[..., None, None]


def _quaternions(turn: F64) -> F64:
    """Returns unit quaternions x y z w (N, K, 4) of rotations, with signs on the shorter arc from the previous key."""
    m = [[turn[..., i, j] for j in range(3)] for i in range(3)]
    # Four formulas for the same quaternion up to a factor; the longest is the most precise (Shepperd 1978).
    ways = np.stack(
        [
            np.stack([1 + m[0][0] - m[1][1] - m[2][2], m[0][1] + m[1][0], m[0][2] + m[2][0], m[2][1] - m[1][2]], -1),
            np.stack([m[0][1] + m[1][0], 1 - m[0][0] + m[1][1] - m[2][2], m[1][2] + m[2][1], m[0][2] - m[2][0]], -1),
            np.stack([m[0][2] + m[2][0], m[1][2] + m[2][1], 1 - m[0][0] - m[1][1] + m[2][2], m[1][0] - m[0][1]], -1),
            np.stack([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + m[0][0] + m[1][1] + m[2][2]], -1),
        ],
        -2,
    )
    best = np.argmax(np.diagonal(ways, axis1=-2, axis2=-1), axis=-1)
    found = np.take_along_axis(ways, best[..., None, None], -2)[..., 0, :]
    found = found / np.sqrt(_dot(found, found))[..., None]
    for k in range(1, found.shape[1]):
        away = _dot(found[:, k], found[:, k - 1]) < 0
        found[:, k] = np.where(away[:, None], -found[:, k], found[:, k])
    return found


def _dot(a: F64, b: F64) -> F64:
    found: F64 = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        found = found + a[..., k] * b[..., k]
    return found


def _half_angles(rotation: F64) -> tuple[F64, F64]:
    """Returns (h, 1 / sin h), each (N, K - 1), where h is half the rotation angle from a key to the next, in radians.

    Both are 0 where there is almost no rotation.
    """
    before, after = rotation[:, :-1], rotation[:, 1:]
    across, along = after - before, after + before  # an arc cosine is imprecise for small angles (Kahan 2006)
    far, near = np.sqrt(_dot(across, across)), np.sqrt(_dot(along, along))
    apart = far > _TOLERANCE
    with np.errstate(divide="ignore"):
        inverse = (far * far + near * near) / (2.0 * far * near)
    return np.where(apart, 2.0 * _arctangent(far / near), 0.0), np.where(apart, inverse, 0.0)


def _arctangent(tangent: F64) -> F64:
    """Returns the arctangents, in radians, of tangents from 0 to 1."""
    for _ in range(2):  # twice halved the angle is below pi / 16, where the series is short
        tangent = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
    square, total = tangent * tangent, np.zeros_like(tangent)
    for k in reversed(range(12)):
        total = total * square + (-1.0) ** k / (2 * k + 1)
    return 4.0 * tangent * total


def _straightest_points(places: F64) -> F64:
    """Returns the point of each body, (N, 3) in body space, whose motion over the keys is nearest to uniform along a line.

    For rotation about an axis it is a point on that axis; for rotation with translation, the centre of rotation.
    """
    if places.shape[1] < 3:
        return np.zeros((len(places), 3))
    bend = places[:, :-2] - 2.0 * places[:, 1:-1] + places[:, 2:]  # A x + b of a point x
    square, side = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3))
    for k in range(bend.shape[1]):
        transposed = np.swapaxes(bend[:, k, :, :3], -1, -2)
        square = square + _product(transposed, bend[:, k, :, :3])
        side = side - _product(transposed, bend[:, k, :, 3:])[..., 0]
    trace = square[:, 0, 0] + square[:, 1, 1] + square[:, 2, 2]
    whole = _norm(places[:, 0, :, :3])
    turns = trace > _MIN_ROTATION * whole * whole
    square = square + np.where(turns, _SLACK * trace, 1.0)[:, None, None] * np.eye(3)
    inverse = np.swapaxes(_inverse_transposed(square), -1, -2)
    return np.where(turns[:, None], _product(inverse, side[..., None])[..., 0], 0.0)
