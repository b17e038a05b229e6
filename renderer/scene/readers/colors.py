"""Converts sRGB vertex colours to linear RGBA."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb
from renderer.scene.description import F32

__all__ = ["vertex_colors"]


def vertex_colors(srgb: npt.NDArray[Any]) -> F32 | None:
    """Returns (V, 4) linear RGBA from (V, 3 or 4) sRGB, as uint8 or in 0..1; None if all colours are white."""
    values = srgb / np.float32(255) if srgb.dtype == np.uint8 else np.clip(np.nan_to_num(srgb.astype(np.float32)), 0, 1)
    colors = np.ones((len(values), 4), np.float32)
    colors[:, : values.shape[1]] = values
    colors[:, :3] = decode_srgb(colors[:, :3])
    return None if (colors == 1).all() else colors
