"""Drafts encoded by a core, for comparison with those of graphics cards."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.film import SAMPLES, Sums
from renderer.jit import entry
from renderer.kernel.draft import draft_word

__all__ = ["draft_of"]


@entry
def _encode(film, scale, words):
    for y in range(words.shape[0]):
        for x in range(words.shape[1]):
            words[y, x] = draft_word(film[0, y, x], film[1, y, x], film[2, y, x], film[SAMPLES, y, x], scale)


def draft_of(sums: Sums, film_exponent: int, exposure: float = 0.0) -> npt.NDArray[np.uint32]:
    """Returns the draft, (h, w) uint32, of sums (planes, h, w)."""
    words = np.empty(sums.shape[1:], np.uint32)
    _encode(sums, np.float32(2.0 ** (exposure - film_exponent)), words)
    return words
