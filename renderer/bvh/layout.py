"""The arrays of a built BVH: where the builder and the traversal agree.

An 8-wide tree. A node keeps its eight children's boxes lane by lane, so that one ray meets all eight in a few instructions;
a leaf is one packet of up to eight triangles, or of up to eight spheres, kept lane by lane likewise, or one instance.
Nodes that no child names, and packets that no leaf does, may lie between the others.

    node           (N, 7, 8) f32   rows: x lower, x upper, y lower, y upper, z lower, z upper, child
    packet         (P, 10, 8) f32  triangles, rows: a.x a.y a.z  b.x b.y b.z  c.x c.y c.z  primitive
                                   spheres, rows:   x y z radius, five rows unused,        primitive
    instance_root  (I,) i32        the node at which each instance's own tree begins
    to_local       (I, 3, 4) f64   from the world into the instance's space: a matrix and, last column, a translation

`child` and `primitive` are int32, kept bit for bit in float32 cells. A child >= 0 is a node; a leaf is ~(4 p) for the
triangle packet p, ~(4 p + 1) for the sphere packet p, ~(4 i + 2) for the instance i. Node 0 is the world's root. A lane
without a child has a box that nothing hits (lower +inf, upper -inf); a lane without a primitive has NaN in all its cells. A
primitive's number is its triangle's index, or the number of triangles + its sphere's index.

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
    "PAGE",
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
PAGE = 4096  # bytes: where parts of arrays begin, so that files of them can be mapped one behind the other
TRIANGLES, SPHERES, INSTANCE = 0, 1, 2  # the kinds of leaves

# The builder halves by number below depth 40, so no tree over 2**31 primitives is deeper than 40 + 31 - 3 levels; each puts
# at most seven children aside. A world's tree may have a tree as its top (parts.py), whose instances are fewer than 2**20: over
# trees of together 2**25 primitives, 57 + 62 levels at most.
MAX_LEVELS = 119
STACK_SIZE = 512


class Bvh(NamedTuple):
    """A bounding volume hierarchy: see the module's docstring."""

    node: npt.NDArray[Any]  # (N, 7, 8) f32
    packet: npt.NDArray[Any]  # (P, 10, 8) f32
    instance_root: npt.NDArray[Any]  # (I,) i32
    to_local: npt.NDArray[Any]  # (I, 3, 4) f64
    instances: Any = True  # None: the kernel need not know of any (renderer/arrays/has.py)
