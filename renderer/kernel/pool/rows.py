"""What a path's row holds while it is in the pool: groups of eight columns, each read and written for eight paths at once."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.wide.rows import gather, scatter

__all__ = [
    "AXES",
    "CARRIED",
    "FACTS",
    "FIRST",
    "FRAME",
    "LAMP",
    "LAST",
    "MAPPED",
    "MATTER",
    "PLACE",
    "RAY",
    "ROW",
    "ROWS",
    "SHADOW",
    "at",
    "read",
    "write",
]

ROWS = 128  # paths; 64 to 256 are as fast
# Groups, by their first columns.
RAY = np.uintp(0)  # origin 3, direction 3, pdf, eta scale: as in integrators/state.py's Path
CARRIED = np.uintp(8)  # radiance 3, depth, throughput 3, number of the vertex that the ray is on its way to
LAST = np.uintp(16)  # the last vertex 3, the normal that it is lit from the side of 3; the hit's u and v
# The hit's t and primitive; pixel key, sample's number, pixel's place in the tile; material (first the instance), light, object.
FACTS = np.uintp(24)
PLACE = np.uintp(32)  # the surface's point 3, error, geometric normal 3, front + 2 smooth
FRAME = np.uintp(40)  # shading normal 3, lift 3, the list that it is on (lists.py), surfaces passed so far
LAMP = np.uintp(48)  # towards the light 3, pdf, radiance 3, alone; then what a shadow ray brings 3, by how many segments
SHADOW = np.uintp(56)  # the shadow ray's start 3 and end 3, whether it is to be cast, whether the path goes on
FIRST = np.uintp(64)  # first hit: albedo 3, distance, normal 3, 1 + object's number; place 3, 1 + material's number
# Only where a scene has more than what is plain:
MATTER = np.uintp(80)  # colour 3, metallic, roughness, eta, first texture coordinates 2
AXES = np.uintp(88)  # the frame to scatter in: s 3, t 3; second texture coordinates 2
MAPPED = np.uintp(96)  # its n 3
ROW = np.uintp(104)  # no power of two, which would put all rows' groups into the same cache sets


@device
def at(row, column):
    """The flat place of a column of one row."""
    return np.uintp(row) * ROW + column


@device
def read(pool, rows, group):
    """The group's eight columns, of eight rows (u32x8): eight f32x8."""
    return gather(pool, rows, ROW, group, 8)


@device
def write(pool, rows, group, columns):
    """The reverse of `read`."""
    scatter(pool, rows, ROW, group, columns)
