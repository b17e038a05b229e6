"""Vertices where the joints of a skin carry them, in the precision that their place asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.skin import carry
from renderer.scene.origin import exact

__all__ = ["carried"]


def carried(*arguments: npt.NDArray[Any], turned: npt.NDArray[Any], bent: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(V, 3) positions, in float64 where `exact` keeps it; fills turned and bent. The others are `carry`'s up to `placed`."""
    point = arguments[3]
    placed: npt.NDArray[Any] = np.empty((len(point), 3), np.float32)
    carry(*arguments, placed, turned, bent)
    if exact(placed.astype(np.float64)).dtype != np.float32:
        placed = np.empty((len(point), 3))
        carry(*arguments, placed, turned, bent)
    return placed
