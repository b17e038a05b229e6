"""Drafts encoded by a core, for comparison with those of graphics cards."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.film import Sums
from renderer.jit import entry
from renderer.kernel.draft import GUIDE_VALUES, LIGHT_VALUES, SMOOTHING_PASSES, draft_word, prepare_pixel, smooth_pixel

__all__ = ["draft_of"]


@entry
def _make(film, scale, gain, passes, light, guides, words):
    height, width = words.shape
    for y in range(height):
        for x in range(width):
            prepare_pixel(film, light, guides, np.uintp(y), np.uintp(x), scale, gain)
    for number in range(passes):
        for y in range(height):
            for x in range(width):
                smooth_pixel(light, guides, y, x, number)
    for y in range(height):
        for x in range(width):
            words[y, x] = draft_word(film, light, passes & 1, np.uintp(y), np.uintp(x), scale)


def draft_of(sums: Sums, film_exponent: int, exposure: float = 0.0, *, is_smooth: bool = False) -> npt.NDArray[np.uint32]:
    """Returns the draft, (h, w) uint32, of sums (planes, h, w)."""
    size = sums.shape[1:]
    words, light = np.empty(size, np.uint32), np.empty((2, *size, LIGHT_VALUES), np.float32)
    scale, gain = np.float32(2.0**-film_exponent), np.float32(2.0**exposure)
    _make(sums, scale, gain, SMOOTHING_PASSES if is_smooth else 0, light, np.empty((*size, GUIDE_VALUES), np.float32), words)
    return words
