"""Transformations of pbrt's directives, at the start and end times."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.animation.curves import slerp
from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.pbrt.notes import Place
from renderer.sentences import Sentence
from renderer.trigonometry import sin_cos

__all__ = ["Ctm", "interpolate", "inverse", "look_at", "matrix", "rotation", "scaling", "translation"]

Ctm = tuple[Matrix, Matrix]  # (4, 4) matrices at the start and end times
_TURNS = 64  # iterations of the polar decomposition


def translation(numbers: Matrix) -> Matrix:
    """Returns the matrix of a translation by three numbers."""
    found = np.eye(4)
    found[:3, 3] = numbers
    return found


def scaling(numbers: Matrix, place: Place) -> Matrix:
    """Returns the matrix of a scale by three numbers. Raises SceneError if any of them is 0."""
    if not np.abs(numbers).min() > 0:
        raise place.error(Sentence("pbrt-scale-zero", "a scale is 0, which flattens the shape to nothing; give another"))
    return np.diag([*numbers, 1.0])


def rotation(degrees: float, axis: Matrix, place: Place) -> Matrix:
    """Returns the matrix of a rotation about an axis. Raises SceneError if the axis is zero or the angle excessive."""
    length = math.sqrt(float((axis * axis).sum()))
    if not length > 0 or abs(degrees) > 1e6:
        raise place.error(Sentence("pbrt-rotate-malformed", "Rotate needs degrees and an axis that is not 0 0 0"))
    x, y, z = (float(v) / length for v in axis)
    sine, cosine = sin_cos(math.radians(degrees))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    found = np.eye(4)
    found[:3, :3] = np.eye(3) + sine * cross + (1 - cosine) * product(cross, cross)
    return found


def look_at(numbers: Matrix, place: Place) -> Matrix:
    """Returns the transform from world to camera space, which looks along +Z with +X to the right.

    numbers: nine values of eye, target and up. Raises SceneError if the direction is zero or parallel to up.
    """
    eye, target, up = numbers[:3], numbers[3:6], numbers[6:]
    forward = _unit(target - eye)
    right = _unit(np.cross(_unit(up), forward))
    if not forward.any() or not right.any():
        raise place.error(
            Sentence(
                "pbrt-look-at-degenerate",
                "LookAt has no direction, or its direction is parallel to the up vector; move the eye, or use another up vector",
            )
        )
    found = np.eye(4)
    found[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    found[:3, 3] = [-float((row * eye).sum()) for row in found[:3, :3]]
    return found


def matrix(numbers: Matrix) -> Matrix:
    """Returns the (4, 4) matrix of 16 numbers in column-major order."""
    return np.array(numbers.reshape(4, 4).T)


def interpolate(ctm: Ctm, share: float) -> Matrix:
    """Interpolates between the transformations at the start and end times, separately in translation, rotation and scale.

    share: fraction of the time between them, clamped to 0..1.
    """
    first, last = ctm
    if share <= 0 or first is last or np.array_equal(first, last):
        return first
    if share >= 1:
        return last
    (turn_a, scale_a), (turn_b, scale_b) = _polar_decomposition(first), _polar_decomposition(last)
    turned = slerp(_quaternion(turn_a), _quaternion(turn_b), share)
    found = np.eye(4)
    found[:3, :3] = product(_rotation_matrix(turned), scale_a * (1 - share) + scale_b * share)
    found[:3, 3] = first[:3, 3] * (1 - share) + last[:3, 3] * share
    return found


def _unit(vector: Matrix) -> Matrix:
    with np.errstate(over="ignore", invalid="ignore"):  # damaged files
        length = math.sqrt(float((vector * vector).sum()))
        return vector / length if length > 0 else np.zeros(3)


def _polar_decomposition(transform: Matrix) -> tuple[Matrix, Matrix]:
    """Returns the rotation and the stretch into which the linear part of a transformation decomposes: rotation @ stretch.

    Reflections belong to the stretch. Source: polar decomposition, Shoemake and Duff 1992.
    """
    whole = transform[:3, :3]
    turn = whole
    for _ in range(_TURNS):
        x, y, z = turn
        cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
        determinant = float((x * cofactors[0]).sum())
        if determinant == 0:
            return np.eye(3), whole
        following = (turn + cofactors / determinant) / 2
        settled = np.abs(following - turn).max() < 1e-14
        turn = following
        if settled:
            break
    x, y, z = turn
    if float((x * np.cross(y, z)).sum()) < 0:
        turn = -turn  # reflections belong to the stretch
    return turn, product(np.ascontiguousarray(turn.T), whole)


def _quaternion(rotation: Matrix) -> list[float]:
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = [1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i]
    largest = squares.index(max(squares))
    rows = (
        (squares[0], b + d, c + g, h - f),
        (b + d, squares[1], f + h, c - g),
        (c + g, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    )
    length = 2 * math.sqrt(max(squares[largest], 1e-300))
    return [v / length for v in rows[largest]]


def _rotation_matrix(quaternion: list[float]) -> Matrix:
    length = math.sqrt(math.fsum(q * q for q in quaternion)) or 1.0
    x, y, z, w = (q / length for q in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def inverse(transform: Matrix, place: Place) -> Matrix:
    """Returns the inverse of an affine transformation. Raises SceneError if it is projective or singular."""
    if not np.array_equal(transform[3], (0.0, 0.0, 0.0, 1.0)):
        raise place.error(
            Sentence(
                "pbrt-transform-projective",
                "a projective transformation is not allowed here; its last row must be 0 0 0 1",
            )
        )
    x, y, z = transform[:3, 0], transform[:3, 1], transform[:3, 2]
    rows = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
    determinant = float((x * rows[0]).sum())
    if determinant == 0 or not np.isfinite(determinant):
        raise place.error(
            Sentence(
                "pbrt-transform-singular",
                "a transformation cannot be inverted; correct it",
            )
        )
    found = np.eye(4)
    found[:3, :3] = rows / determinant
    found[:3, 3] = -product(found[:3, :3], transform[:3, 3:])[:, 0]
    return found
