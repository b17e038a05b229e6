"""Error margins of a triangle: the distance of ray origins from its edges, and the intersection's positional error."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec

__all__ = ["edge_margins"]

_TINY = np.float32(1e-30)
_MOST = np.float32(np.finfo(np.float32).max)
_ROOT_3 = np.float32(1.7320509)  # rounded up
_SLIVER = np.float32(0.25 * 2.0**-24)
_AT_MOST = np.float32(0.125)  # of the inscribed circle's radius
_ROUNDED = np.float32(2.0**-23)  # error bound of the area, relative to the squared perimeter


@device
def edge_margins(a, b, c, cross):
    """Returns (an upper bound of 1 / inscribed radius, the distance from the triangle at which a ray may find a hit).

    cross: cross product of the edges. The distance is significant only for slivers, where float32's error in the hit distance
    grows as the length squared over the width. The perimeter is bounded by the edges' largest coordinates.
    """
    perimeter = vec.magnitude(vec.sub(b, a)) + vec.magnitude(vec.sub(c, a)) + vec.magnitude(vec.sub(c, b))
    twice_area = math.sqrt(vec.dot(cross, cross)) - _ROUNDED * perimeter * perimeter
    curvature = min(_ROOT_3 * perimeter / max(twice_area, _TINY), _MOST)
    return curvature, min(_SLIVER * perimeter * perimeter * curvature, _AT_MOST / max(curvature, _TINY))
