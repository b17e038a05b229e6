"""RGB9E5: radiance in 4 bytes a pixel, three 9-bit mantissas and one 5-bit exponent, as OpenGL's RGB9_E5 textures take it.

Source: OpenGL EXT_texture_shared_exponent; the word is UNSIGNED_INT_5_9_9_9_REV (exponent in the top bits, red in the lowest).
The error of every channel is at most half a step: 2**-9 of the brightest channel (a little under 0.2 %).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["MAX", "pack", "unpack"]

MANTISSA_BITS = 9
BIAS = 15
MAX = 65408.0  # (2**9 - 1) / 2**9 * 2**16


def pack(rgb: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """Packs (..., 3) float32 radiance into (...) uint32 words. Negative values and NaN become 0; values above MAX become MAX."""
    clean = np.fmin(np.fmax(np.asarray(rgb, np.float32), np.float32(0)), np.float32(MAX))
    brightest = np.maximum(np.maximum(clean[..., 0], clean[..., 1]), clean[..., 2])
    # floor(log2(x)) is a float's exponent field; half a mantissa step is added first, so that rounding up to 2**9 moves
    # on to the next exponent as the specification demands.
    rounded = brightest * np.float32(1 + 2.0 ** -(MANTISSA_BITS + 1))
    exponent = np.maximum((rounded.view(np.int32) >> 23) - 127, -BIAS - 1) + 1 + BIAS
    step_inverse = ((127 + BIAS + MANTISSA_BITS - exponent) << 23).astype(np.int32).view(np.float32)
    mantissa = (clean * step_inverse[..., None] + np.float32(0.5)).astype(np.uint32)
    np.minimum(mantissa, 511, out=mantissa)
    words = mantissa[..., 0] | mantissa[..., 1] << 9 | mantissa[..., 2] << 18 | exponent.astype(np.uint32) << 27
    return np.asarray(words, np.uint32)


def unpack(words: npt.NDArray[np.uint32]) -> npt.NDArray[np.float32]:
    """Unpacks (...) uint32 words into (..., 3) float32 radiance: mantissa times 2**(exponent - 24)."""
    words = np.asarray(words, np.uint32)
    mantissa = np.stack([words & 511, words >> 9 & 511, words >> 18 & 511], axis=-1).astype(np.float32)
    step = ((words >> 27).astype(np.int32) + (127 - BIAS - MANTISSA_BITS)) << 23
    return mantissa * step.view(np.float32)[..., None]
