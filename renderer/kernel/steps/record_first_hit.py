"""What the film stores of a path's first vertex."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.steps.state import FirstHit
from renderer.wide.values import as_wide, nil, u32

__all__ = ["no_hit", "record_first_hit"]

_NEXT, _NONE = np.uint32(1), np.uint32(0)


@device
def record_first_hit(surface, albedo, normal, distance, start):
    """Returns the FirstHit of a vertex.

    normal: the shading normal on the viewer's side, or zero for a vertex in a medium, whose object and material are none;
    distance: along the ray; start: distance of the ray's origin from the lens.
    """
    number, material = u32(surface.object + _NEXT), u32(surface.material + _NEXT)
    return FirstHit(albedo, distance + start, normal, number, surface.point, material)


@device
def no_hit(like):
    """Returns the FirstHit of a path that hits nothing. like: a float or lanes."""
    none, nothing = nil(like), as_wide(_NONE, like)
    black = none, none, none
    return FirstHit(black, none, black, nothing, black, nothing)
