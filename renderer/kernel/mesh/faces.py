"""Per-triangle queries of a mesh: whether a triangle has a non-zero area, and the bounding box of triangles."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, entry

__all__ = ["find_corners", "find_solid"]


@device
def _edges(position, triangle, i):
    """Returns triangle i's edge vectors from corner a to b and from a to c, float64."""
    a, b, c = triangle[i, 0], triangle[i, 1], triangle[i, 2]
    x, y, z = np.float64(position[a, 0]), np.float64(position[a, 1]), np.float64(position[a, 2])
    return (position[b, 0] - x, position[b, 1] - y, position[b, 2] - z), (
        position[c, 0] - x,
        position[c, 1] - y,
        position[c, 2] - z,
    )


@entry
def find_solid(position, triangle, first, end, solid):
    """Marks in `solid` which of the triangles first ... end - 1 have a non-zero area; returns their number."""
    count = 0
    for i in range(first, end):
        u, v = _edges(position, triangle, i)
        # Compared, not subtracted: with a fused multiply-add the rounding error would count as an area.
        solid[i] = u[1] * v[2] != u[2] * v[1] or u[2] * v[0] != u[0] * v[2] or u[0] * v[1] != u[1] * v[0]
        count += solid[i]
    return count


@entry
def find_corners(position, triangle, first, end, corner):
    """Fills corner (2, 3) with the bounding box of the triangles `first` to `end` - 1: minimum, then maximum coordinates."""
    for k in range(3):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for i in range(first, end):
            for c in range(3):
                value = position[triangle[i, c], k]
                low, high = min(low, value), max(high, value)
        corner[0, k], corner[1, k] = low, high
