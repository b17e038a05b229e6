"""Computes cutpoint tables: start indices from which `sample_cdf_row` of renderer/kernel/light/environment.py searches a cdf."""

from __future__ import annotations

import numpy as np

from renderer.scene.description import F32, I32

__all__ = ["cutpoints"]

_INTERVALS = 4  # cdf intervals per table entry: more entries make the table large, fewer require more than one load


def cutpoints(cdf: F32) -> I32:
    """Divides [0, 1) into C equal parts, and returns for each the index of the cdf interval that contains the part's lower end.

    cdf: (..., N + 1); result (..., C). C is a power of two, so that the part that contains a number is found without rounding.
    """
    count = cdf.shape[-1] - 1
    parts = 1 << max(0, (count - 1).bit_length() - (_INTERVALS - 1).bit_length())
    lower = np.arange(parts, dtype=np.float32) / np.float32(parts)
    inner = cdf.reshape(-1, count + 1)[:, 1:count]
    found = [np.searchsorted(row, lower, side="right") for row in inner]
    return np.array(found, np.int32).reshape(*cdf.shape[:-1], parts)
