"""Lossy encoding of a picture that is still noisy: brightness in 5 bits, one hue per 2 x 2 pixels.

The brightness b = r + g + b of a pixel becomes the code q = 1 + 32 (e + 24) + m of the nearest 2**e (1 + m / 32), or 0 below
2**-24; the error is at most 1.6 %. The hue is r / b and g / b of the sums of four pixels, in units of 1 / 255. A picture takes
an eighth to a fifth of the bytes of its RGB9E5 words.

JPEG and WebP are a third of that size, but a page can read their pixels only through a canvas, which browsers falsify to protect
privacy, and their error per pixel is unbounded.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["coarse", "count_hues", "radiance"]

LOWEST_BRIGHTNESS = 2.0**-24
HIGHEST_BRIGHTNESS = 65408.0  # the maximum of RGB9E5
DROPPED_BITS = 18  # of a float's 23 mantissa bits
LEAST_CODE = (127 - 24) << 5


def coarse(mean: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
    """Encodes radiance of shape (3, h, w).

    Returns brightness codes (h, w), and hues (2, ceil(h / 2), ceil(w / 2)): the fractions of red and green in units of 1 / 255.
    """
    clean = np.fmin(np.fmax(mean, np.float32(0)), np.float32(HIGHEST_BRIGHTNESS))
    bright = clean[0] + clean[1] + clean[2]
    rounded = (bright.view(np.int32) + (1 << DROPPED_BITS - 1)) >> DROPPED_BITS
    codes = np.maximum(rounded - (LEAST_CODE - 1), 0).astype(np.int16)
    height, width = bright.shape
    if height % 2 or width % 2:
        clean = np.pad(clean, ((0, 0), (0, height % 2), (0, width % 2)))
    of_four = clean[:, 0::2, 0::2] + clean[:, 0::2, 1::2] + clean[:, 1::2, 0::2] + clean[:, 1::2, 1::2]
    scale = np.float32(255) / np.maximum(of_four[0] + of_four[1] + of_four[2], np.float32(LOWEST_BRIGHTNESS))
    return codes, (of_four[:2] * scale + np.float32(0.5)).astype(np.uint8)


def count_hues(width: int, height: int) -> int:
    """Returns the number of hues of a picture: one per 2 x 2 pixels."""
    return -(-width // 2) * -(-height // 2)


def radiance(codes: npt.NDArray[np.int32], hue: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Decodes brightness codes (h, w) and hues (2, count_hues(w, h)) to radiance (3, h, w)."""
    height, width = codes.shape
    # A code is the exponent and the highest bits of the mantissa of a float, side by side.
    bright = np.where(codes > 0, ((codes + (LEAST_CODE - 1)) << DROPPED_BITS).astype(np.int32).view(np.float32), np.float32(0))
    shares = hue.reshape(2, -(-height // 2), -(-width // 2)).repeat(2, 1).repeat(2, 2)[:, :height, :width]
    red, green = shares.astype(np.float32) / np.float32(255)
    return np.stack([bright * red, bright * green, bright * np.maximum(1 - red - green, 0)])
