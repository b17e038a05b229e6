"""Scales pictures to the available space."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PIL import Image

from renderer.image import tonemap

__all__ = ["fitted_picture", "fitted_size"]

F32 = npt.NDArray[np.float32]


def fitted_size(size: tuple[int, int], available: tuple[int, int]) -> tuple[int, int]:
    """Returns the size of a picture of `size` scaled to fit into `available`, at least 1 x 1. Enlarges only by integers."""
    scale = min(available[0] / size[0], available[1] / size[1])
    if scale >= 1:
        return size[0] * int(scale), size[1] * int(scale)
    return max(int(size[0] * scale), 1), max(int(size[1] * scale), 1)


def fitted_picture(film: F32, size: tuple[int, int], exposure: float, curve: str) -> npt.NDArray[np.uint8]:
    """Returns the tone-mapped picture of linear radiance (h, w, 3) scaled to `size`; pixels are means of those they cover."""
    if (film.shape[1], film.shape[0]) != size:
        film = np.stack([np.asarray(Image.fromarray(film[..., c]).resize(size, Image.Resampling.BOX)) for c in range(3)], axis=-1)
    return tonemap.apply(film, exposure, curve)
