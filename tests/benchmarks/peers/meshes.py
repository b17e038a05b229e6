"""Generated meshes with any number of triangles."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import Image, Mesh

__all__ = ["checks", "displaced_sphere", "torus"]


def displaced_sphere(triangles: int, material: int = 0) -> Mesh:
    """Returns a bumpy sphere of radius about 1 with about `triangles` triangles, smooth normals and UVs."""
    rows = max(4, round(math.sqrt(triangles / 4)))
    columns = 2 * rows
    theta, phi = np.meshgrid(np.linspace(0, math.pi, rows + 1), np.linspace(0, 2 * math.pi, columns + 1), indexing="ij")
    out = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    x, y, z = np.moveaxis(out, -1, 0)
    radius = 1 + 0.08 * np.sin(5 * x + 1) * np.sin(6 * y) * np.sin(5 * z + 2) + 0.01 * np.sin(40 * x) * np.sin(43 * y + z * 37)
    return _grid("sphere", out * radius[..., None], material, poles=True)


def torus(triangles: int, material: int = 0, winding: float = 3.0) -> Mesh:
    """Returns a torus with varying tube radius, about `triangles` triangles, smooth normals and UVs."""
    rows = max(4, round(math.sqrt(triangles / 4)))
    u, v = np.meshgrid(np.linspace(0, 2 * math.pi, 2 * rows + 1), np.linspace(0, 2 * math.pi, rows + 1), indexing="ij")
    tube = 0.32 + 0.08 * np.sin(winding * u)
    around = 0.8 + tube * np.cos(v)
    return _grid("torus", np.stack([around * np.cos(u), around * np.sin(u), tube * np.sin(v)], -1), material)


def checks(size: int, seed: int = 0) -> Image:
    """Returns a texture (size, size) of coloured squares with fine grain."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:size, 0:size]
    colors = rng.integers(40, 220, (8, 8, 3))
    pixels = colors[y * 8 // size, x * 8 // size] + rng.integers(-30, 30, (size, size, 1))
    opaque = np.full((size, size, 1), 255)
    return Image("checks", np.concatenate([pixels.clip(0, 255), opaque], -1).astype(np.uint8))


def _grid(name: str, points: np.ndarray, material: int, poles: bool = False) -> Mesh:
    """Returns a mesh over a grid of points (rows + 1, columns + 1, 3), with smooth normals that face away from the origin.

    poles: whether all points of the first row coincide, and all of the last; their triangles without area are left out.
    """
    rows, columns = points.shape[0] - 1, points.shape[1] - 1
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    first = np.stack([corner, below + 1, below], 1)
    second = np.stack([corner, corner + 1, below + 1], 1)
    if poles:
        first, second = first[:-columns], second[columns:]
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    triangles = np.concatenate([first, second]).astype(np.int32)
    positions = points.reshape(-1, 3)
    normals = _vertex_normals(positions, triangles, rows, columns)
    if np.einsum("ij,ij->", normals, positions) < 0:
        triangles, normals = triangles[:, ::-1], -normals
    return Mesh(
        name,
        positions.astype(np.float32),
        np.ascontiguousarray(triangles),
        normals.astype(np.float32),
        np.stack([u, v], -1).reshape(-1, 2).astype(np.float32),
        material,
    )


def _vertex_normals(positions: np.ndarray, triangles: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Returns the mean normal of the adjacent triangles for each grid point.

    The first and the last column count as the same points.
    """
    corner = positions[triangles]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.stack([np.bincount(triangles.ravel(), np.repeat(face[:, k], 3), len(positions)) for k in range(3)], -1).reshape(
        rows + 1, columns + 1, 3
    )
    total[:, 0] += total[:, -1]
    total[:, -1] = total[:, 0]
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.divide(total, length, out=np.full_like(total, 3**-0.5), where=length > 0).reshape(-1, 3)
