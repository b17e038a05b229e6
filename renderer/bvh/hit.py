"""The result of a traversal, and the constants and rules that all traversals share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.node_test import ANY_PRIMITIVE
from renderer.bvh.simd import select
from renderer.jit import device

__all__ = ["FACING", "FROM_ORIGIN", "NO_PRIMITIVE", "SHADOW_REACH", "Hit", "skip_limit"]

NO_PRIMITIVE = np.int32(-1)
FACING = np.bool_(True)  # `facing` of `closest_hit`
# Fraction of a shadow ray along which surfaces occlude: rounding may cause a hit on a distant light's surface before the end.
SHADOW_REACH = np.float32(1 - 2.0**-21)
FROM_ORIGIN = (np.float32(0.0), ANY_PRIMITIVE, ANY_PRIMITIVE)  # `after` of a ray that has passed no surface yet


class Hit(NamedTuple):
    """The closest hit of a ray, or none: `primitive` is then NO_PRIMITIVE."""

    t: float  # along the ray, in units of its direction's length
    primitive: int  # triangles first, then spheres; NO_PRIMITIVE without a hit
    u: float  # barycentric coordinates of the triangle's corners b and c; 0 for spheres
    v: float
    instance: int  # whose space the primitive is in; -1 for the world's
    time: Any = None  # of the ray, as passed to `closest_hit`


@device
def skip_limit(after, number):
    """Returns the primitive number up to which hits at the same distance as the hit `after` are skipped.

    number: the instance whose primitives are compared with that limit; -1: the world.
    """
    limit = ANY_PRIMITIVE
    if after is not None:
        limit = select(number > after[1], NO_PRIMITIVE, select(number < after[1], ANY_PRIMITIVE, after[2]))
    return limit
