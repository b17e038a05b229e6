"""The octahedral map between unit vectors and the unit square, without trigonometry: for one vector or for eight.

A unit vector is projected on the octahedron |x| + |y| + |z| = 1, whose lower half is folded over the corners of the upper one.
The map does not preserve area: its density varies by 3 sqrt(3). Engelhardt & Dachsbacher, "Octahedron Environment Maps", 2008.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.wide.values import where

__all__ = ["octahedron_to_square", "square_to_octahedron", "square_to_octahedron_pdf"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_QUARTER = np.float32(0.25)


@device
def _folded(x, y):
    """Returns the point of the square [-1, 1]^2 that is (x, y) mirrored at the edge of the upper half, in the same quadrant."""
    a, b = _ONE - abs(y), _ONE - abs(x)
    return where(x < _ZERO, -a, a), where(y < _ZERO, -b, b)


@device
def square_to_octahedron(u):
    """Returns the unit vector of a point of the unit square."""
    x, y = _TWO * u[0] - _ONE, _TWO * u[1] - _ONE
    z = _ONE - abs(x) - abs(y)
    below = z < _ZERO
    a, b = _folded(x, y)
    return vec.normalize((where(below, a, x), where(below, b, y), z))


@device
def octahedron_to_square(w):
    """Returns the point of the unit square of a unit vector: the inverse of `square_to_octahedron`, up to rounding."""
    scale = _ONE / (abs(w[0]) + abs(w[1]) + abs(w[2]))
    x, y = w[0] * scale, w[1] * scale
    a, b = _folded(x, y)
    below = w[2] < _ZERO
    x, y = where(below, a, x), where(below, b, y)
    return _HALF * x + _HALF, _HALF * y + _HALF


@device
def square_to_octahedron_pdf(w):
    """Returns the pdf, per steradian, of `square_to_octahedron` at the unit vector w, for points uniform over the square.

    An area of the face at distance r from the centre subtends 1 / r^3 of its projection, and r is 1 / (|x| + |y| + |z|).
    """
    inverse = _ONE / (abs(w[0]) + abs(w[1]) + abs(w[2]))
    return _QUARTER * inverse * inverse * inverse
