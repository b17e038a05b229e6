"""Separates coincident faces back to back: two triangles with the same corners and opposite orientations.

A ray hits both at the same distance, and rounding would decide between them. Each is offset a little towards its own front:
a viewer on either side sees the face with its front towards them, whatever the order in the file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32

__all__ = ["separate_coincident"]

I64 = npt.NDArray[np.int64]

_SEPARATION = 2.0**-17  # relative to the scene's size: about eight micrometres per metre
_ULPS = 2.0**-21  # relative to the coordinates: the resolution of float32
_HASH_FACTORS = [np.uint64(each) for each in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63)]
_HALF = np.uint64(32)


def separate_coincident(
    position: F32, triangle: I32, material: I32, attributes: Sequence[F32], begins: Sequence[int] = ()
) -> F32:
    """Returns the vertices (V, 3), offset where two coincident triangles face opposite ways and look different.

    triangle: (T, 3). material: (T,). attributes: (V, n) each, vertex attributes that affect the look, such as colours. begins:
    the first triangle of each further coordinate space; triangles in different spaces are never coincident.
    """
    attributes = [each for each in attributes if len(each) and (each != each[0]).any()]
    if len(triangle) < 2 or (not attributes and material.min() == material.max()):
        return position
    numbers = _candidates_by_hash(position, triangle, begins)
    if not len(numbers):
        return position
    space = np.searchsorted(np.asarray(begins, np.int64), numbers, "right")
    corners = position[triangle[numbers]].astype(np.float64) + 0.0  # turns -0 into 0
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Sums over corners do not depend on their order.
    sums = [each[triangle[numbers]].astype(np.float64).sum(axis=1) for each in attributes]
    chosen = _has_opposite_face(_number_by_corners(corners, space), normal, _number_rows([material[numbers], *sums]))
    moved = np.zeros((len(position), 3))
    for each in np.unique(space[chosen]).tolist():
        here = np.flatnonzero(chosen & (space == each))
        first, end = ([0, *begins, len(triangle)][each + k] for k in range(2))
        size = float(np.ptp(position[triangle[first:end].reshape(-1)], axis=0).max())
        step = max(_SEPARATION * size, _ULPS * float(np.abs(corners[here]).max()))
        unit = normal[here] / np.linalg.norm(normal[here], axis=1, keepdims=True)
        for k in range(3):
            moved[triangle[numbers[here], k]] = step * unit
    return (position + moved).astype(np.float32) if chosen.any() else position


def _candidates_by_hash(position: F32, triangle: I32, begins: Sequence[int]) -> I64:
    """Returns the triangles with the same three corners, in any order, as another one; includes a few false positives."""
    vertex = np.zeros(len(position), np.uint64)
    for axis in range(3):
        bits = (position[:, axis] + np.float32(0)).view(np.uint32) * _HASH_FACTORS[axis]
        vertex += (bits ^ (bits >> _HALF)) * _HASH_FACTORS[axis]
    vertex = (vertex ^ (vertex >> _HALF)) * _HASH_FACTORS[3]
    code = vertex[triangle[:, 0]] + vertex[triangle[:, 1]] + vertex[triangle[:, 2]]
    for begin in begins:
        code[begin:] += _HASH_FACTORS[0]
    ordered = np.sort(code)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    return np.flatnonzero(np.isin(code, twice)) if len(twice) else np.zeros(0, np.int64)


def _number_by_corners(corners: npt.NDArray[np.float64], space: I64) -> I64:
    """Returns (N,) group numbers of triangles: equal for triangles in one coordinate space with the same corners in any order."""
    order = np.lexsort(corners.transpose(2, 0, 1), axis=1)
    return _number_rows([np.take_along_axis(corners, order[..., None], axis=1).reshape(len(corners), 9), space])


def _number_rows(columns: Sequence[npt.NDArray[np.generic]]) -> I64:
    """Returns (N,) group numbers of a table's rows: equal for rows that are equal in all columns."""
    _, number = np.unique(np.column_stack(columns), axis=0, return_inverse=True)
    return number.reshape(-1)


def _has_opposite_face(place: I64, normal: npt.NDArray[np.float64], appearance: I64) -> npt.NDArray[np.bool_]:
    """Returns a mask (N,) of triangles that coincide with another of opposite orientation and a different appearance.

    place: (N,) group numbers, equal for coincident triangles; appearance: (N,), equal for triangles that look the same.
    """
    count = int(place.max()) + 1
    first = np.full(count, len(place))
    np.minimum.at(first, place, np.arange(len(place)))
    side = np.einsum("ij,ij->i", normal, normal[first[place]]) > 0
    with_first = np.zeros(count, np.int64)
    with_first[place[side]] = appearance[side]
    meets = np.zeros(count, bool)
    meets[place[~side][appearance[~side] != with_first[place[~side]]]] = True
    return meets[place]
