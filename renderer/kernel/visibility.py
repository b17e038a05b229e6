"""What lies between two points: how much of the light gets through."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import any_hit
from renderer.jit import device
from renderer.kernel import vec

__all__ = ["transmittance"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)


@device
def transmittance(scene, stack, start, end):
    """The fraction of light, 0 ... 1, that passes from `start` to `end` in a straight line."""
    return _ZERO if any_hit(scene.bvh, stack, start, vec.sub(end, start), _ONE) else _ONE
