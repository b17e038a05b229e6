"""Points without a surface, as a scanner leaves them: each a small ball, all of them one mesh."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Mesh
from renderer.scene.readers.colors import vertex_colors

__all__ = ["MOST_POINTS", "balls", "spacing"]

MOST_POINTS = 1_000_000
_FINE = 200_000  # up to so many have balls of 20 triangles, more of 8
_SAMPLES = 48
_GOLDEN = (1 + 5**0.5) / 2


def _icosahedron() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    a, b = 1.0, _GOLDEN
    corners = [(0, s * a, t * b) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([*corners, *((y, z, x) for x, y, z in corners), *((z, x, y) for x, y, z in corners)], np.float64)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 1.1
    faces = [(i, j, k) for i, j, k in combinations(range(12), 3) if near[i, j] and near[j, k] and near[i, k]]
    return points, _outwards(points, np.array(faces))


def _octahedron() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(i, j, k) for i in (0, 3) for j in (1, 4) for k in (2, 5)]
    return points, _outwards(points, np.array(faces))


def _outwards(points: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    a, b, c = (points[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def spacing(points: F32) -> float:
    """How far points are from their nearest neighbours: the median of some of them; 0 where they all lie in one place."""
    if len(points) < 2:
        return 0.0
    chosen = np.linspace(0, len(points) - 1, min(_SAMPLES, len(points))).astype(np.int64)
    found = []
    for i in chosen:
        apart = points - points[i]
        square = np.einsum("ij,ij->i", apart, apart)
        others = square[square > 0]
        found += [float(others.min())] if len(others) else []
    return float(np.sqrt(np.median(found))) if found else 0.0


def balls(name: str, points: F32, colors: npt.NDArray[np.uint8] | None, radius: float | None = None) -> tuple[Mesh, float]:
    """A mesh of a ball about each point, and the balls' radius: without one they reach to their neighbours.

    colors: (P, 3 or 4) sRGB.
    """
    corners, faces = _icosahedron() if len(points) <= _FINE else _octahedron()
    extent = float(np.ptp(points, axis=0).max(initial=0.0))
    radius = radius or spacing(points) or extent / 100 or 0.01
    positions = (points[:, None] + np.float32(radius) * corners.astype(np.float32)[None]).reshape(-1, 3)
    step = np.arange(len(points))[:, None, None] * len(corners)
    triangles = (faces[None] + step).reshape(-1, 3).astype(np.int32)
    normals = np.tile(corners.astype(np.float32), (len(points), 1))
    linear = None if colors is None else vertex_colors(colors)
    shown = None if linear is None else np.repeat(linear, len(corners), axis=0)
    return Mesh(name, positions, triangles, normals, colors=shown), radius
