"""An image's pixels as light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb
from renderer.scene.description import Image

__all__ = ["linear"]


def linear(image: Image) -> npt.NDArray[np.float32]:
    """An image's scene-linear pixels, (h, w, 3)."""
    pixels = np.asarray(image.pixels[..., :3], np.float32)
    if image.pixels.dtype != np.uint8:
        return pixels
    return np.asarray(decode_srgb(pixels / 255) if image.srgb else pixels / 255, np.float32)
