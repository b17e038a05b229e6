"""Resamples equirectangular images under a rotation or reflection of the sphere."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Image
from renderer.scene.matrices import Matrix
from renderer.scene.readers.linear_images import linear

__all__ = ["FROM_PLUS_Z", "rotate_environment"]

FROM_PLUS_Z = np.diag([-1.0, 1.0, -1.0])  # for images with their centre at +Z; ours have it at -Z


def rotate_environment(image: Image, rotation: Matrix, least_height: int = 1) -> Image:
    """Returns an equirectangular image resampled under a rotation or reflection of its directions.

    rotation: (3, 3) orthonormal matrix from the image's directions, in which the centre is -Z, to world directions. least_height:
    minimum height in pixels of the result, which is twice as wide as high.
    """
    pixels = linear(image)
    height = max(pixels.shape[0], least_height)
    theta = (np.arange(height) + 0.5)[:, None] * np.pi / height
    phi = (np.arange(2 * height) + 0.5)[None, :] * np.pi / height - np.pi
    directions = np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)), axis=-1)
    x, y, z = np.moveaxis(directions @ rotation, -1, 0)  # rows times matrix: the inverse rotation
    row = np.arccos(np.clip(y, -1, 1)) / np.pi * pixels.shape[0] - 0.5
    column = (np.arctan2(x, -z) + np.pi) / (2 * np.pi) * pixels.shape[1] - 0.5
    return Image(f"{image.name} turned", _bilinear_samples(pixels, row, column), srgb=False)


def _bilinear_samples(pixels: npt.NDArray[Any], row: npt.NDArray[Any], column: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Returns bilinear samples of pixels at fractional rows and columns; columns wrap around."""
    height, width = pixels.shape[:2]
    above, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = (row - above)[..., None], (column - left)[..., None]
    rows = [np.clip(above + k, 0, height - 1) for k in (0, 1)]
    columns = [(left + k) % width for k in (0, 1)]
    upper, lower = (pixels[r, columns[0]] * (1 - right) + pixels[r, columns[1]] * right for r in rows)
    result: npt.NDArray[np.float32] = (upper * (1 - down) + lower * down).astype(np.float32)
    return result
