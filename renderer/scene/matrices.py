"""Products of transforms with the same bits on every host; those of a BLAS depend on the processor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Matrix", "product"]

Matrix = npt.NDArray[np.float64]


def product(outer: Matrix, inner: Matrix) -> Matrix:
    """Returns the product (..., m, n) of (..., m, k) and (..., k, n), broadcast: applies `inner` first, then `outer`."""
    found: Matrix = outer[..., :, 0, None] * inner[..., None, 0, :]
    for k in range(1, outer.shape[-1]):
        found = found + outer[..., :, k, None] * inner[..., None, k, :]
    return found
