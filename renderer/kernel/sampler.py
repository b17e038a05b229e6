"""Counter-based random numbers: a function of (seed, pixel, sample number, dimension) and of nothing else.

pcg4d of Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020: four numbers from four counters.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device

__all__ = ["pixel_key", "uniform4"]

_MULTIPLIER = np.uint32(1664525)
_INCREMENT = np.uint32(1013904223)
_SHIFT = np.uint32(16)
_FIFTEEN = np.uint32(15)
_MIX_1 = np.uint32(0x7FEB352D)
_MIX_2 = np.uint32(0x846CA68B)
_DISCARD = np.uint32(8)
_STEP = np.float32(2.0**-24)


@device
def _lcg(x):
    return np.uint32(np.uint32(x * _MULTIPLIER) + _INCREMENT)


@device
def _mad(x, y, z):
    return np.uint32(x + np.uint32(y * z))


@device
def _unit(x):
    """The upper 24 bits as a float32 in [0, 1)."""
    return np.float32(np.uint32(x >> _DISCARD)) * _STEP


@device
def pixel_key(x, y):
    """The pixel as a counter: the same whatever the frame's size or the tile.

    Mixed one to one (lowbias32 of Wellons, "Prospecting for Hash Functions", 2018): y stands in the upper bits, and pcg4d's
    products carry a counter's bits upwards only, so that along a column the numbers' low bits would not be even.
    """
    key = np.uint32(np.uint32(y) << _SHIFT) | np.uint32(x)
    key = np.uint32(np.uint32(key ^ np.uint32(key >> _SHIFT)) * _MIX_1)
    key = np.uint32(np.uint32(key ^ np.uint32(key >> _FIFTEEN)) * _MIX_2)
    return np.uint32(key ^ np.uint32(key >> _SHIFT))


@device
def uniform4(seed, pixel, sample, block):
    """Four numbers in [0, 1), the dimensions 4 block ... 4 block + 3. All arguments uint32."""
    x = _lcg(np.uint32(pixel))
    y = _lcg(np.uint32(sample))
    z = _lcg(np.uint32(block))
    w = _lcg(np.uint32(seed))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    x = np.uint32(x ^ np.uint32(x >> _SHIFT))
    y = np.uint32(y ^ np.uint32(y >> _SHIFT))
    z = np.uint32(z ^ np.uint32(z >> _SHIFT))
    w = np.uint32(w ^ np.uint32(w >> _SHIFT))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    return _unit(x), _unit(y), _unit(z), _unit(w)
