"""Luminance of linear Rec.709 colours."""

from __future__ import annotations

import numpy as np

__all__ = ["REC_709", "luminance"]

REC_709 = np.array([0.2126, 0.7152, 0.0722])  # of linear red, green and blue; the same in kernel/vec.py and in the page


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Returns the Rec.709 luminance of (..., 3) linear colours: (...) float64, with the same bits on every host, unlike `@`."""
    red, green, blue = (rgb[..., k] * REC_709[k] for k in range(3))
    brightness: np.ndarray = (red + green) + blue
    return brightness
