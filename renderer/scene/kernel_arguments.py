"""Prepares arrays as kernel arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["read_only"]


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns the array as a read-only C-contiguous one, copied only if necessary, so that kernels get a single array type."""
    view = np.require(array, requirements=["C", "A"]).view()
    view.flags.writeable = False
    return view
