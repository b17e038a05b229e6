"""How far rays keep from a triangle's edges: see `_inward` in renderer/kernel/surface/surface.py."""

from __future__ import annotations

import numpy as np

from renderer.scene.description import F32, I32

__all__ = ["edge_margins"]

_TINY = 1e-30
_SLIVER = 0.25 * 2.0**-24
_AT_MOST = 0.125  # of the inscribed circle's radius


def edge_margins(position: F32, triangle: I32) -> F32:
    """(T, 2): an upper bound of one over the inscribed circle's radius; how far off the triangle a ray may find it.

    That is much only in slivers, where float32 is worse than elsewhere at the distance at which a ray meets the triangle: by
    its length squared over its width.
    """
    a, b, c = (position[triangle[:, k]].astype(np.float64) for k in range(3))
    perimeter = sum(np.abs(edge).max(axis=1) for edge in (b - a, c - a, c - b))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    curvature = np.sqrt(3.0) * perimeter / np.maximum(twice_area, _TINY)
    miss = np.minimum(_SLIVER * perimeter * perimeter * curvature, _AT_MOST / np.maximum(curvature, _TINY))
    return np.minimum(np.stack([curvature, miss], axis=1), np.finfo(np.float32).max).astype(np.float32)
