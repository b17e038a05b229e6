"""A picture in reduced precision, shown while it clears up: brightness in 5 bits, one hue for 2 x 2 pixels.

Brightness b = r + g + b of every pixel becomes the code q = 1 + 32 (e + 24) + m of the nearest 2**e (1 + m / 32), 0 where it is
below 2**-24: off by 1.6 % at most. Hue is r / b and g / b of four pixels together, in 255ths: of their sums, so that a pixel's
hue counts by its brightness, and one that is black tells none. Noise hides both; a whole picture takes an eighth to a fifth of
the bytes of its RGB9E5 words.

JPEG and WebP need a third of that, but a page can read their pixels only through a canvas, which browsers that guard against
fingerprinting falsify, and they do not bound the error of any pixel.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["coarse"]

LEAST = 2.0**-24
MOST = 65408.0  # as RGB9E5's
DROPPED_BITS = 18  # of a float's mantissa of 23
LEAST_CODE = (127 - 24) << 5


def coarse(mean: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
    """Of radiance (3, h, w): brightness (h, w), and hue (2, ceil(h / 2), ceil(w / 2)), red's and green's share."""
    clean = np.fmin(np.fmax(mean, np.float32(0)), np.float32(MOST))
    bright = clean[0] + clean[1] + clean[2]
    rounded = (bright.view(np.int32) + (1 << DROPPED_BITS - 1)) >> DROPPED_BITS
    codes = np.maximum(rounded - (LEAST_CODE - 1), 0).astype(np.int16)
    height, width = bright.shape
    if height % 2 or width % 2:
        clean = np.pad(clean, ((0, 0), (0, height % 2), (0, width % 2)))
    of_four = clean[:, 0::2, 0::2] + clean[:, 0::2, 1::2] + clean[:, 1::2, 0::2] + clean[:, 1::2, 1::2]
    scale = np.float32(255) / np.maximum(of_four[0] + of_four[1] + of_four[2], np.float32(LEAST))
    return codes, (of_four[:2] * scale + np.float32(0.5)).astype(np.uint8)
