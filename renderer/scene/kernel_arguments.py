"""Prepares arrays as kernel arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["read_only"]


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns a read-only view of the array, or a copy if it is not C-contiguous: Numba then compiles for one array type only."""
    view = np.require(array, requirements=["C", "A"]).view()
    view.flags.writeable = False
    return view
