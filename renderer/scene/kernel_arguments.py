"""How compiled code is handed what it reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["read_only"]


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A view of the array, or a copy where it is not in order: one type for the compiler, wherever an array comes from."""
    view = np.require(array, requirements=["C", "A"]).view()
    view.flags.writeable = False
    return view
