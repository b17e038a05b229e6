"""Finds pairs of triangles that form parallelograms, as most area lights do. Each pair is one light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.arrays.light_rows import CORNER, CORNER_ERROR, EDGES, PARALLELOGRAM, RECIPROCAL
from renderer.scene.description import F32

__all__ = ["pair", "tabulate_parallelograms"]

_CLOSED = 1e-6  # relative tolerance of a parallelogram's fourth corner
_THIN = 1e-3  # minimum area relative to the product of the edge lengths: below it, the reciprocal edges would be too long
_ERROR = 32 * 2.0**-24  # the same as for points of triangles in renderer/kernel/surface/surface.py


def pair(corners: np.ndarray, alike: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int64], np.ndarray]:
    """Finds pairs of consecutive triangles that form parallelograms: returns their first triangles, and the parallelograms.

    corners: (n, 3, 3). alike: (n - 1,), whether a triangle and the next one emit equally at every point. Returns (m,) int64, no
    two consecutive, and (m, 4, 3) float64: a corner, its two neighbours, and the opposite corner. The first three are in the
    first triangle's orientation; both triangles have the same front.
    """
    if len(corners) < 2:
        return np.zeros(0, np.int64), np.zeros((0, 4, 3))
    found = np.zeros(len(corners) - 1, bool)
    shape = np.zeros((len(corners) - 1, 4, 3))
    a, b = corners[:-1], corners[1:]
    for i in range(3):
        p, s, t = a[:, i], a[:, (i + 1) % 3], a[:, (i + 2) % 3]
        size = np.abs(corners[:-1] - p[:, None]).max(axis=(1, 2))
        edges = np.linalg.norm(s - p, axis=1) * np.linalg.norm(t - p, axis=1)
        solid = np.linalg.norm(np.cross(s - p, t - p), axis=1) > _THIN * edges
        for j in range(3):
            q = b[:, j]
            joined = (b[:, (j + 1) % 3] == t).all(axis=1) & (b[:, (j + 2) % 3] == s).all(axis=1)
            closed = np.abs(p + q - s - t).max(axis=1) <= _CLOSED * size
            new = joined & closed & solid & alike & ~found
            found |= new
            shape[new] = np.stack([p, s, t, q], axis=1)[new]
    first = _alternate(found)
    return first, shape[first]


def _alternate(found: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Returns the indices of every second True in each run of consecutive True values, starting with the run's first."""
    number = np.arange(len(found))
    start = np.maximum.accumulate(np.where(found, -1, number))  # the last False, before the run
    return np.flatnonzero(found & ((number - start) % 2 == 1))


def tabulate_parallelograms(light_indices: npt.NDArray[np.int64], shapes: np.ndarray, lights: int) -> F32:
    """Returns CompiledScene.light_parallelogram; no rows if no light is a parallelogram.

    light_indices: (m,) indices of the lights that are parallelograms. shapes: their corners from `pair`. lights: number of all
    lights.
    """
    if not len(light_indices):
        return np.zeros((0, PARALLELOGRAM), np.float32)
    table = np.zeros((lights, PARALLELOGRAM))
    corner, u, v = shapes[:, 0], shapes[:, 1] - shapes[:, 0], shapes[:, 2] - shapes[:, 0]
    normal = np.cross(u, v)
    square = (normal * normal).sum(axis=1, keepdims=True)
    table[light_indices, CORNER : CORNER + 3] = corner
    table[light_indices, EDGES : EDGES + 6] = np.concatenate([u, v], axis=1)
    table[light_indices, RECIPROCAL : RECIPROCAL + 6] = (
        np.concatenate([np.cross(v, normal), np.cross(normal, u)], axis=1) / square
    )
    table[light_indices, CORNER_ERROR] = _ERROR * np.abs(shapes).max(axis=(1, 2))
    return table.astype(np.float32)
