"""Per-ray constants for tests against boxes and triangles; for one ray or for eight lanes.

Hit distances on triangles are rounded, and biased by the side that the ray hits (`meet_triangles` in renderer/bvh/packet.py).
Culling of boxes must allow for both, or the nearest hit would depend on the order in which boxes are visited. So all distances
of boxes are reduced by a factor, `NEARER`, and by a multiple of `margin_of`: both exceed the bias.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device

__all__ = ["MORE", "NEARER", "begins_at", "margin_of", "planes_of"]

NEARER = np.float32(1 - 2.0**-18)  # factor of the reciprocal direction, for boxes
MORE = np.float32(1 + 2.0**-20)  # factor of a hit's distance, for the rounding of the division by the determinant
_ZERO = np.float32(0.0)
_SLACK = np.float32(4 * 2.0**-24)
_OF_ORIGIN = np.float32(0.25)
_LEAD = np.float32(2.0**-18)
_EARLIER = np.float32(1 - 2.0**-16)


@device
def margin_of(o, scale):
    """Returns the distance added to a hit's own in the bound of its error, for the rounding of coordinates.

    Two tessellations of one plane differ by the rounding of their vertices, some ulps of their coordinates, however short the ray
    is. scale: 1 / the direction's component of largest magnitude.
    """
    return max(abs(o[0]), max(abs(o[1]), abs(o[2]))) * abs(scale) * _OF_ORIGIN


@device
def planes_of(o, inverse, margin):
    """Returns the constants (near plane, far plane) of one axis: a ray hits a plane at x at distance x * inverse + constant.

    inverse: reciprocal of the direction's component, times `NEARER`.
    """
    constant = -o * inverse
    slack = abs(constant) * _SLACK
    return constant - (slack + margin * _LEAD), constant + slack


@device
def begins_at(t, margin):
    """Returns the distance, at least 0, such that boxes ending before it contain no hit at distance t or beyond."""
    return max(t * _EARLIER - margin * _LEAD, _ZERO)
