"""What a path's row holds while it is in the pool: groups of eight columns, each read and written for eight paths at once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.wide.rows import gather, scatter

__all__ = [
    "AT",
    "CARRIED",
    "FACTS",
    "FIRST",
    "FRAME",
    "LAMP",
    "LAST",
    "PLACE",
    "RAY",
    "ROW",
    "ROWS",
    "SHADOW",
    "Facts",
    "Frame",
    "Lamp",
    "Last",
    "Place",
    "at",
    "read",
    "write",
]

ROWS = 128  # paths; 64 to 256 are as fast
# Groups, by their first columns.
RAY = np.uintp(0)  # origin 3, direction 3, pdf, eta scale: as in integrators/state.py's Path
CARRIED = np.uintp(8)  # radiance 3, depth, throughput 3, number of the vertex that the ray is on its way to
LAST = np.uintp(16)  # the last vertex 3, the normal that it is lit from the side of 3; the hit's u and v
FACTS = np.uintp(24)  # the hit's t and primitive; pixel key, sample's number, pixel's place in the tile; material, light, object
PLACE = np.uintp(32)  # the surface's point 3, error, geometric normal 3, front + 2 smooth
FRAME = np.uintp(40)  # shading normal 3, lift 3, class (lists.py)
LAMP = np.uintp(48)  # towards the light 3, pdf, radiance 3, alone; then what a shadow ray is for 3
SHADOW = np.uintp(56)  # the shadow ray's start 3 and end 3, whether it is to be cast, whether the path goes on
FIRST = np.uintp(64)  # first hit: albedo 3, distance, normal 3, 1 + object's number; place 3, 1 + material's number
ROW = np.uintp(80)  # no power of two, which would put all rows' groups into the same cache sets
AT = np.uintp(8)


class Last(NamedTuple):
    """The group LAST."""

    vertex: Any
    normal: Any
    u: Any
    v: Any


class Facts(NamedTuple):
    """The group FACTS; whole numbers by their bits."""

    t: Any
    primitive: Any
    pixel: Any
    sample: Any
    place: Any
    material: Any
    light: Any
    object: Any


class Place(NamedTuple):
    """The group PLACE."""

    point: Any
    error: Any
    geometric: Any
    flags: Any


class Frame(NamedTuple):
    """The group FRAME."""

    normal: Any
    lift: Any
    which: Any


class Lamp(NamedTuple):
    """The group LAMP."""

    direction: Any
    pdf: Any
    radiance: Any
    alone: Any


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
