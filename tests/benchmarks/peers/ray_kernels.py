"""Traces many rays through a BVH on one thread, in a loop like Embree's: read a ray, trace it, store the hit."""

from __future__ import annotations

from renderer.bvh.traverse import any_hit, closest_hit
from renderer.jit import entry

__all__ = ["trace_any", "trace_closest"]


@entry
def trace_closest(bvh, stack, origin, direction, reach, distance, primitive):
    """Traces each ray to its closest hit; writes the hit's distance and primitive.

    distance: in multiples of the length of the ray's direction. primitive: -1 for no hit. reach: maximum distance, in the same
    unit.
    """
    for i in range(len(origin)):
        o = (origin[i, 0], origin[i, 1], origin[i, 2])
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        hit = closest_hit(bvh, stack, o, d, reach)
        distance[i] = hit[0]
        primitive[i] = hit[1]


@entry
def trace_any(bvh, stack, origin, direction, reach, met):
    """Traces each ray until it hits anything; writes 0 to `met` for rays that hit, and -1 for the others."""
    for i in range(len(origin)):
        o = (origin[i, 0], origin[i, 1], origin[i, 2])
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        met[i] = 0 if any_hit(bvh, stack, o, d, reach) else -1
