"""Detects images that look black on a screen although they contain light: because of dim lamps, or another program's units."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["DarkPicture", "darkness"]

DARK_THRESHOLD = 0.01  # of white: below it a picture looks black
BRIGHTEST = 0.995  # quantile: a few fireflies or a lamp do not make a picture bright


class DarkPicture(NamedTuple):
    """The result of `darkness` for an image that looks black.

    brightest: the quantile BRIGHTEST of the pixels' radiances. exposure: the number of stops that make this radiance white.
    """

    brightest: float
    exposure: float


def darkness(picture: npt.NDArray[Any]) -> DarkPicture | None:
    """Returns the DarkPicture of a scene-linear (h, w, 3) image that looks black: its brightness and the exposure that it needs.

    Returns None if the image is bright enough, or completely black.
    """
    peaks = np.nan_to_num(picture, posinf=0.0).max(axis=-1)
    brightest = float(np.quantile(peaks, BRIGHTEST))
    if not 0.0 < brightest < DARK_THRESHOLD:
        return None
    return DarkPicture(brightest, math.floor(-2.0 * math.log2(brightest)) / 2.0)
