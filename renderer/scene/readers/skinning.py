"""Skins vertices at the precision that their coordinates need."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.skin import carry
from renderer.scene.origin import in_exact_type

__all__ = ["carried"]


def carried(*arguments: npt.NDArray[Any], turned: npt.NDArray[Any], bent: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns (V, 3) skinned positions, in float64 where `in_exact_type` requires it; fills in the normals and tangents.

    arguments: the arguments of `carry` (renderer/kernel/mesh/skin.py) up to `placed`. turned, bent: arrays to fill with the
    skinned normals and tangents.
    """
    point = arguments[3]
    placed: npt.NDArray[Any] = np.empty((len(point), 3), np.float32)
    carry(*arguments, placed, turned, bent)
    if in_exact_type(placed.astype(np.float64)).dtype != np.float32:
        placed = np.empty((len(point), 3))
        carry(*arguments, placed, turned, bent)
    return placed
