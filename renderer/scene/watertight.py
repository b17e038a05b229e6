"""Tests whether a mesh is closed."""

from __future__ import annotations

import numpy as np

from renderer.scene.deduplicate import unique_rows
from renderer.scene.description import F32, I32

__all__ = ["is_closed"]


def is_closed(positions: F32, triangles: I32) -> bool:
    """Returns True if every edge of the mesh is used equally often in both directions, after merging vertices at equal positions.

    positions: (V, 3). triangles: (T, 3). A closed, consistently wound surface divides space into an inside and an outside.
    """
    _, place = unique_rows(positions)
    corners = place[triangles]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    if len(corners) == 0:
        return False
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    count = int(corners.max()) + 1
    return bool(np.array_equal(np.sort(start * count + end), np.sort(end * count + start)))
