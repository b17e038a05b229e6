"""Transforms a mesh's points and normals into world space."""

from __future__ import annotations

import numpy as np

from renderer.jit import entry

__all__ = ["place_all_normals", "place_all_points", "place_normals", "place_points"]


@entry
def place_points(point, transform, first, end, placed):
    """Transforms points first ... end - 1 by a 4x4 matrix into `placed`.

    Returns the largest absolute coordinate; NaN if one is NaN.
    """
    largest = 0.0
    for i in range(first, end):
        x, y, z = np.float64(point[i, 0]), np.float64(point[i, 1]), np.float64(point[i, 2])
        for k in range(3):
            value = transform[k, 0] * x + transform[k, 1] * y + transform[k, 2] * z + transform[k, 3]
            placed[i, k] = value
            largest = largest if abs(value) <= largest else abs(value)
    return largest


@entry
def place_normals(normal, matrix, first, end, placed, length):
    """Transforms normals first ... end - 1 by a 3x3 matrix into `placed`, normalised.

    Stores their lengths before normalisation in `length`.
    """
    for i in range(first, end):
        x, y, z = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
        nx = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        ny = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        nz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        length[i] = np.sqrt(nx * nx + ny * ny + nz * nz)
        placed[i, 0], placed[i, 1], placed[i, 2] = nx / length[i], ny / length[i], nz / length[i]


@entry
def place_all_points(point, transform, start, placed):
    """Transforms the points of many meshes: rows start[m] ... start[m + 1] - 1 by transform[m]; see `place_points`."""
    largest = 0.0
    for m in range(len(transform)):
        value = place_points(point, transform[m], start[m], start[m + 1], placed)
        largest = value if value > largest or value != value else largest
    return largest


@entry
def place_all_normals(normal, matrix, start, placed, length):
    """Transforms the normals of many meshes: rows start[m] ... start[m + 1] - 1 by matrix[m]; see `place_normals`."""
    for m in range(len(matrix)):
        place_normals(normal, matrix[m], start[m], start[m + 1], placed, length)
