"""The layout of light-tree nodes (bounds of eight children, one per lane) and of parallelogram rows, for builder and kernel.

A child is bounded by a sphere around all its lights, a cone around their axes, and the maximum angle of emission from those.
Infinitely distant lights are bounded likewise, by a sphere at distance 1 from any shading point, in their direction.
A lane without a child has no power.
"""

from __future__ import annotations

__all__ = [
    "AXIS",
    "CHILD",
    "CORNER",
    "CORNER_ERROR",
    "COS_REACH",
    "COS_SPREAD",
    "EDGES",
    "END",
    "INTENSITY",
    "LIGHT_ROWS",
    "LIGHT_WIDTH",
    "MIRROR",
    "NEAR",
    "NO_END",
    "PARALLELOGRAM",
    "PLACE",
    "RADIUS",
    "RECIPROCAL",
    "SIN_SPREAD",
]

LIGHT_WIDTH = 8
LIGHT_ROWS = 15
# What is asked of each child comes first, so that it lies in few of the cache's lines.
PLACE = 0  # three rows: the sphere's middle, negated; of distant lights, their axis
NEAR = 3  # 1; of distant lights 0
RADIUS = 4  # of distant lights the sine of their spread, or 2 where that is a right angle or more: one stands among them
INTENSITY = 5
COS_SPREAD = 6  # that of the angle by which axes differ from the common one; -1 of distant lights, and where there is no child
CHILD = 7  # int32, bit for bit: a node, or ~ the number of a light
AXIS = 8  # three rows, a unit vector; of distant lights 0
MIRROR = 11  # -1 where one shines to both sides, else 1
SIN_SPREAD = 12
COS_REACH = 13  # that of the angle by which light leaves its axis; 0 beyond a right angle, where the tree expects none
END = 14  # int32: one more than the number of the last light of a child; NO_END in a lane without one
NO_END = 2**31 - 1

# Of a parallelogram, a cache line; all 0 of other lights.
PARALLELOGRAM = 16
CORNER = 0  # three columns
EDGES = 3  # three columns each: from there to the corners beside it; their cross product points to the side that is in front
RECIPROCAL = 9  # three each: by which the dot product of a point less the corner is how far it is along an edge, 0 ... 1
CORNER_ERROR = 15  # how far a point may be off in float32; more than 0
