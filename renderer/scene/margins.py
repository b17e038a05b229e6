"""How far rays keep from a triangle's edges: see `_inward` in renderer/kernel/surface/surface.py."""

from __future__ import annotations

import numpy as np

from renderer.kernel.mesh.faces import fill_margins
from renderer.scene.description import F32, I32
from renderer.scene.readable import read_only
from renderer.threads import PART, Team, parts_of

__all__ = ["edge_margins"]


def edge_margins(position: F32, triangle: I32, team: Team) -> F32:
    """(T, 2): an upper bound of one over the inscribed circle's radius; how far off the triangle a ray may find it.

    That is much only in slivers, where float32 is worse than elsewhere at the distance at which a ray meets the triangle: by
    its length squared over its width.
    """
    position, triangle = read_only(position), read_only(triangle)
    margin = np.empty((len(triangle), 2), np.float32)
    team.each(lambda part: fill_margins(position, triangle, *part, margin), parts_of(0, len(triangle), PART))
    return margin
