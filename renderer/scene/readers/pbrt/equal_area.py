"""Converts equal-area octahedral images of all directions to equirectangular images.

Source: Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.matrices import Matrix, product

__all__ = ["equirectangular", "to_square"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

_MOST_ROWS = 2048
_ROWS = 64  # rows computed at a time
_SUPERSAMPLING = 2  # supersampling per axis


def to_square(directions: F64) -> tuple[F64, F64]:
    """Maps (..., 3) unit directions to coordinates (u, v) of the equal-area square, 0..1; +Z is at the centre."""
    x, y, z = np.moveaxis(directions, -1, 0)
    r = np.sqrt(np.maximum(1 - np.abs(z), 0))
    most, least = np.maximum(np.abs(x), np.abs(y)), np.minimum(np.abs(x), np.abs(y))
    phi = np.arctan2(least, np.maximum(most, 1e-300)) * 2 / np.pi
    phi = np.where(np.abs(x) < np.abs(y), 1 - phi, phi)
    v, u = phi * r, r - phi * r
    below = z < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return (np.copysign(u, x) + 1) / 2, (np.copysign(v, y) + 1) / 2


def equirectangular(pixels: F32, rotation: Matrix) -> F32:
    """Returns an (h, 2h, 3) equirectangular image with the same total flux as an equal-area image; +Y is up, -Z at the centre.

    pixels: (n, n, 3) equal-area image; rotation: (3, 3) rotation applied to its directions.
    """
    height = min(len(pixels), _MOST_ROWS)
    whole = np.empty((height, 2 * height, 3), np.float32)
    fine = _SUPERSAMPLING * height
    phi = (np.arange(2 * fine) + 0.5) * np.pi / fine - np.pi
    back = np.ascontiguousarray(rotation.T)
    for first in range(0, height, _ROWS):
        rows = min(_ROWS, height - first)
        theta = ((np.arange(rows * _SUPERSAMPLING) + first * _SUPERSAMPLING + 0.5) * np.pi / fine)[:, None]
        around = np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)), axis=-1)
        u, v = to_square(product(back, around[..., None])[..., 0])
        found = _bilinear_samples(pixels, u, v)
        whole[first : first + rows] = found.reshape(rows, _SUPERSAMPLING, 2 * height, _SUPERSAMPLING, 3).mean(axis=(1, 3))
    weight = np.sin((np.arange(height) + 0.5) * np.pi / height)
    seen = (whole.mean(axis=1, dtype=np.float64) * weight[:, None]).sum(axis=0) / weight.sum()
    meant = pixels.mean(axis=(0, 1), dtype=np.float64)
    factor = np.where(seen > 0, meant / np.maximum(seen, 1e-300), 1.0)
    return np.asarray(whole * np.clip(factor, 0.5, 2.0).astype(np.float32))


def _bilinear_samples(pixels: F32, u: F64, v: F64) -> F64:
    """Returns bilinear samples of an equal-area image. Beyond an edge, the square continues where that edge is folded."""
    size = len(pixels)
    x, y = u * size - 0.5, v * size - 0.5
    left, above = np.floor(x).astype(int), np.floor(y).astype(int)
    across, down = (x - left)[..., None], (y - above)[..., None]

    def pixel_at(column: npt.NDArray[np.int64], row: npt.NDArray[np.int64]) -> F32:
        out = (column < 0) | (column >= size)
        row = np.where(out, size - 1 - row, row)
        column = np.clip(column, 0, size - 1)
        out = (row < 0) | (row >= size)
        column = np.where(out, size - 1 - column, column)
        return np.asarray(pixels[np.clip(row, 0, size - 1), column])

    upper = pixel_at(left, above) * (1 - across) + pixel_at(left + 1, above) * across
    lower = pixel_at(left, above + 1) * (1 - across) + pixel_at(left + 1, above + 1) * across
    return np.asarray(upper * (1 - down) + lower * down)
