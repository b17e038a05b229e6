"""The arrays of a built BVH: where the builder and the traversal agree.

An 8-wide tree. A node keeps its eight children's boxes lane by lane, so that one ray meets all eight in a few instructions;
a leaf is one packet of up to eight triangles, or of up to eight spheres, kept lane by lane likewise, or one instance.

    node           (N, 7, 8) f32   rows: x lower, x upper, y lower, y upper, z lower, z upper, child
    packet         (P, 10, 8) f32  triangles, rows: a.x a.y a.z  b.x b.y b.z  c.x c.y c.z  primitive
                                   spheres, rows:   x y z radius, five rows unused,        primitive
    instance_root  (I,) i32        the node at which each instance's own tree begins
    to_local       (I, 3, 4) f64   from the world into the instance's space: a matrix and, last column, a translation
    motion         (R, 18) f64     of instances that move while the shutter is open, their keys (motion.py), which count instead:
    motion_first   (I + 1,) i32    those of instance i are rows motion_first[i] ... motion_first[i + 1] - 1, none if it stands still
    instance_keys  (I,) i32        how often each packet of its tree is there, once for each key of the shutter; 1: no vertex moves

`child` and `primitive` are int32, kept bit for bit in float32 cells. A child >= 0 is a node; a leaf is ~(4 p) for the
triangle packet p, ~(4 p + 1) for the sphere packet p, ~(4 i + 2) for the instance i. Node 0 is the world's root. A lane
without a child has a box that nothing hits (lower +inf, upper -inf); a lane without a primitive has NaN in all its cells. A
primitive's number is its triangle's index, or the number of triangles + its sphere's index.

A packet whose vertices move is as many packets, one behind the other, and the leaf names the first; what lies between two keys is
straight. Boxes hold all of a motion.

An instance is a tree shown somewhere: two levels and no more. Many instances share one tree, which lies in its own space;
it holds triangles only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy.typing as npt

__all__ = [
    "INSTANCE",
    "MAX_LEVELS",
    "NODE_ROWS",
    "NODE_SIZE",
    "PACKET_ROWS",
    "PACKET_SIZE",
    "ROW_CHILD",
    "ROW_PRIMITIVE",
    "SPHERES",
    "STACK_SIZE",
    "TRIANGLES",
    "WIDTH",
    "Bvh",
]

WIDTH = 8
NODE_ROWS = 7
ROW_CHILD = 6
PACKET_ROWS = 10
ROW_PRIMITIVE = 9
NODE_SIZE = NODE_ROWS * WIDTH
PACKET_SIZE = PACKET_ROWS * WIDTH
TRIANGLES, SPHERES, INSTANCE = 0, 1, 2  # the kinds of leaves

# The builder halves by number below depth 40, so no tree over 2**31 primitives is deeper than 40 + 31 - 3 levels; each puts
# at most seven children aside.
MAX_LEVELS = 68
STACK_SIZE = 512


class Bvh(NamedTuple):
    """A bounding volume hierarchy: see the module's docstring."""

    node: npt.NDArray[Any]  # (N, 7, 8) f32
    packet: npt.NDArray[Any]  # (P, 10, 8) f32
    instance_root: npt.NDArray[Any]  # (I,) i32
    to_local: npt.NDArray[Any]  # (I, 3, 4) f64
    motion: npt.NDArray[Any]  # (R, 18) f64
    motion_first: npt.NDArray[Any]  # (I + 1,) i32
    instance_keys: npt.NDArray[Any]  # (I,) i32
    instances: Any = True  # None: the kernel need not know of any (renderer/arrays/has.py)
