"""The table layouts of light-tree nodes (bounds of eight children, one per lane), of parallelogram lights, and of targets.

The builder writes these tables and the kernel reads them. A child is bounded by a sphere around all its lights, a cone around
their axes, and the maximum angle of emission from those axes. Infinitely distant lights are bounded likewise, by a sphere at
distance 1 from any shading point, in their direction. A lane without a child has no power.
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
    "PIVOT_CDF",
    "PIVOT_CENTER",
    "PIVOT_COLUMNS",
    "PIVOT_RADIUS",
    "PLACE",
    "RADIUS",
    "RECIPROCAL",
    "SIN_SPREAD",
    "TARGET_CENTER",
    "TARGET_COLUMNS",
    "TARGET_GUARD",
    "TARGET_GUARD2",
    "TARGET_RADIUS",
    "TARGET_STRENGTH",
]

LIGHT_WIDTH = 8
LIGHT_ROWS = 15
# The rows needed first for each child come first, so that they share few cache lines.
PLACE = 0  # three rows: the sphere's centre, negated; for distant lights, their axis
NEAR = 3  # 1; 0 for distant lights
RADIUS = 4  # for distant lights the sine of their spread, or 2 if that is a right angle or more: the shading point is inside
INTENSITY = 5
COS_SPREAD = 6  # of the maximum angle between the axes and the common axis; -1 for distant lights and empty lanes
CHILD = 7  # int32, bit for bit: a node, or ~ the number of a light
AXIS = 8  # three rows, a unit vector; 0 for distant lights
MIRROR = 11  # -1 if a light emits to both sides, else 1
SIN_SPREAD = 12
COS_REACH = 13  # of the maximum angle between emitted light and its axis; 0 beyond a right angle, where the tree expects none
END = 14  # int32: one more than the number of a child's last light; NO_END in an empty lane
NO_END = 2**31 - 1

# Columns of a parallelogram's row, one cache line; all 0 for other lights.
PARALLELOGRAM = 16
CORNER = 0  # three columns
EDGES = 3  # three columns each: from the corner to its neighbours; their cross product points to the front
RECIPROCAL = 9  # three each: dot product with a point minus the corner is its coordinate along an edge, 0 ... 1
CORNER_ERROR = 15  # bound of a point's rounding error in float32; more than 0

# Columns of a target's row. Directions are sampled towards a sphere, from points outside a second sphere that contains the first.
TARGET_COLUMNS = 9
TARGET_CENTER = 0  # three columns
TARGET_RADIUS = 3
TARGET_GUARD = 4  # three columns: the centre of the second sphere
TARGET_GUARD2 = 7  # its squared radius
TARGET_STRENGTH = 8  # relative, above 0: how often the target is chosen, before distance is taken into account

# Columns of a pivot's row: a small lamp towards which distances in media are sampled.
PIVOT_COLUMNS = 5
PIVOT_CENTER = 0  # three columns
PIVOT_RADIUS = 3
PIVOT_CDF = 4  # probability of this lamp and of those before it; 1 in the last row
