"""Draft of a picture: its means in 8 bits a colour, on a scale that leaves exposure and tone curve to the viewer.

A colour's code is round(255 log2(1 + 255 x) / DRAFT_STOPS), where x is its radiance times 2**exposure, up to 16. A step is 3 % of
the radiance where that is well above 1 / 255. protocol/pictures.py has the packet, and web/js/film/film-shader.js decodes it.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.polynomial import log2
from renderer.wide.values import u32

__all__ = ["DRAFT_STOPS", "draft_word"]

DRAFT_STOPS = 12
_ZERO, _HALF, _ONE, _MOST = (np.float32(value) for value in (0.0, 0.5, 1.0, 255.0))
_CODES_A_STOP = np.float32(255 / DRAFT_STOPS)
_GREEN, _BLUE = np.uint32(8), np.uint32(16)


@device
def _code(x):
    """Returns the code of radiance x times 2**exposure, uint32 in [0, 255]; that of negative radiance is 0."""
    return u32(min(log2(_ONE + _MOST * max(x, _ZERO)) * _CODES_A_STOP + _HALF, _MOST))


@device
def draft_word(red, green, blue, samples, scale):
    """Returns the codes of a pixel's mean colour, uint32, red in the lowest byte; 0 without samples.

    red, green, blue: sums of the film, int64. samples: their number, int64. scale: 2**(exposure - film_exponent), float32.
    """
    step = scale / max(np.float32(samples), _ONE)
    codes = _code(np.float32(red) * step), _code(np.float32(green) * step), _code(np.float32(blue) * step)
    return u32(codes[0] | codes[1] << _GREEN | codes[2] << _BLUE)
