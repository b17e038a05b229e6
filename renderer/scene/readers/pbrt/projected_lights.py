"""Emission maps of pbrt's goniometric and projection lights.

pbrt looks up the nearest pixel, while emission maps are interpolated; small images are enlarged first, so that edges stay in
place.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import F32, EmissionMap
from renderer.scene.readers.light_maps import projected_map
from renderer.scene.readers.pbrt.equal_area import to_square

__all__ = ["goniometric", "projected_power", "projection"]

_MIN_SIDE = 512  # minimum pixels per side
_ROWS = (256, 1024)  # minimum and maximum of spherical images
_SUPERSAMPLING = 2  # supersampling per axis
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def goniometric(pixels: F32, is_mirrored: bool) -> EmissionMap:
    """Returns the emission map of a goniometric light from its (n, n) grey equal-area image, whose centre is the light's +Y.

    The emission map's axis is the light's +Z. is_mirrored: whether light space is left-handed in our world, so that +X is to the
    right when looking along +Z.
    """
    size = len(pixels)
    height = min(max(2 * size, _ROWS[0]), _ROWS[1])
    fine = _SUPERSAMPLING * height
    phi = (np.arange(2 * fine) + 0.5) * math.pi / fine
    theta = ((np.arange(fine) + 0.5) * math.pi / fine)[:, None]
    side = 1.0 if is_mirrored else -1.0
    x, y = side * np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    u, v = to_square(np.stack([x, np.broadcast_to(np.cos(theta), x.shape), y], axis=-1))
    column, row = (np.minimum((place * size).astype(np.int64), size - 1) for place in (u, v))
    found = pixels[row, column].reshape(height, _SUPERSAMPLING, 2 * height, _SUPERSAMPLING).mean(axis=(1, 3))
    values = np.repeat(found[..., None], 3, axis=2).astype(np.float32)
    return EmissionMap("sphere", values, (0.0, 2 * math.pi, 0.0, math.pi))


def projection(pixels: F32, fov: float, is_mirrored: bool) -> EmissionMap:
    """Returns the emission map of a projected (h, w, 3) image.

    fov: degrees across the smaller side; is_mirrored: as for `goniometric`.
    """
    half_width, half_height = _half_extents(pixels, fov)
    pixels = pixels if is_mirrored else pixels[:, ::-1]
    times = max(1, _MIN_SIDE // max(pixels.shape[:2]))
    return projected_map(np.repeat(np.repeat(pixels, times, axis=0), times, axis=1), half_width, half_height)


def projected_power(pixels: F32, fov: float) -> float:
    """Returns the luminous power of a projection light with scale 1, summed over pixels as in pbrt."""
    half_width, half_height = _half_extents(pixels, fov)
    height, width = pixels.shape[:2]
    x = half_width * ((np.arange(width) + 0.5) / width * 2 - 1)
    y = half_height * ((np.arange(height) + 0.5) / height * 2 - 1)
    weight = (1 + x * x + (y * y)[:, None]) ** -1.5
    return float(4 * half_width * half_height * (pixels @ _LUMINANCE * weight).mean())


def _half_extents(pixels: F32, fov: float) -> tuple[float, float]:
    height, width = pixels.shape[:2]
    half = math.tan(math.radians(min(max(fov, 0.01), 178.0)) / 2)
    return half * max(1.0, width / height), half * max(1.0, height / width)
