"""An approximation of 1 / sqrt(x) for weights that need no precision: only integer operations and products.

The result has the same bits on every processor, unlike that of rsqrtps. A root and a division would take seven times as long.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import fma, splat
from renderer.jit import device
from renderer.wide.values import as_floats, as_ints, zero_like

__all__ = ["inverse_root"]

_HALVED = np.uint32(1)
# Kadlec, "Improving the fast inverse square root", 2010: the constants that minimise the error after one Newton step.
_START = np.uint32(0x5F1FFFF9)
_SCALE = np.float32(0.703952253)
_LIMIT = np.float32(2.38924456)


@device
def inverse_root(x):
    """Returns 1 / sqrt(x) with an error of at most 0.07 % in each lane of an f32x8, for 2e-38 < x < 2e38.

    Contains no product that the compiler could fuse.
    """
    y = as_floats(_START - (as_ints(x) >> _HALVED))
    return y * splat(_SCALE) * fma(zero_like(x) - x * y, y, splat(_LIMIT))
