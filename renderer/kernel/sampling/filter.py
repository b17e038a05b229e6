"""Pixel filters by importance sampling: film samples are distributed like the filter function.

Each sample has weight 1 and belongs to one pixel, and tiles need no border (Ernst et al., "Filter Importance Sampling", 2006).
The filters are separable and non-negative.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.jit import device
from renderer.settings import FILTERS
from renderer.wide.values import lookup, to_float, to_int

__all__ = ["BLACKMAN_HARRIS", "BOX", "TENT", "blackman_harris", "filter_offset"]

BLACKMAN_HARRIS, TENT, BOX = (np.int32(FILTERS.index(name)) for name in ("blackman-harris", "tent", "box"))

RADIUS = 0.75  # of Blackman-Harris, in pixels: 1.5 wide, the default of Cycles
_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INTERVALS = 256
_NEXT = np.uint32(1)


def blackman_harris(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the four-term window function of Harris (1978): 1 at x = 0, and 0 outside -RADIUS to RADIUS.

    It is not normalised.
    """
    turn = 2 * np.pi * (np.asarray(x, np.float64) / (2 * RADIUS) + 0.5)
    value = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    return np.where(np.abs(x) <= RADIUS, value, 0.0)


def _inverse() -> npt.NDArray[np.float32]:
    """Returns, for t = 0, 1/_INTERVALS ... 1, the distance from the middle beyond which a fraction t**2 of the window lies.

    The table is indexed by the root of the fraction, which resolves the window's flat ends as finely as its middle.
    """
    x = np.linspace(0, RADIUS, 100_001)
    value = blackman_harris(x)
    beyond = np.concatenate([[0], np.cumsum((value[:-1] + value[1:])[::-1])])
    t = np.linspace(0, 1, _INTERVALS + 1)
    return np.interp(t**2, beyond / beyond[-1], x[::-1]).astype(np.float32)


_INVERSE = _inverse()


@device
def _blackman_harris_offset(u):
    side = _TWO * u - _ONE
    t = math.sqrt(max(_ZERO, _ONE - abs(side))) * np.float32(_INTERVALS)
    i = to_int(min(t, np.float32(_INTERVALS - 1)))
    rest = t - to_float(i)
    near = lookup(_INVERSE, i)
    return math.copysign(near + rest * (lookup(_INVERSE, i + _NEXT) - near), side)


@device
def _tent_offset(u):
    side = _TWO * u - _ONE
    return math.copysign(_ONE - math.sqrt(max(_ZERO, _ONE - abs(side))), side)


@device
def filter_offset(kind, u):
    """Returns a sample's offset from the pixel's centre along one axis, in pixels; u in [0, 1).

    Range: 0.75 for Blackman-Harris; 1 for the tent, inverted analytically; 0.5 for the box.
    """
    if kind == BLACKMAN_HARRIS:
        return _blackman_harris_offset(u)
    return u - _HALF if kind == BOX else _tent_offset(u)
