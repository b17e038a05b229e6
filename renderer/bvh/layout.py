"""The arrays of a built BVH: where the builder and the traversal agree.

An 8-wide tree. A node keeps its eight children's boxes lane by lane, so that one ray meets all eight in a few instructions;
a leaf is one packet of up to eight triangles, or of up to eight spheres, kept lane by lane likewise.

    node    (N, 7, 8) f32   rows: x lower, x upper, y lower, y upper, z lower, z upper, child
    packet  (P, 10, 8) f32  triangles, rows: a.x a.y a.z  b.x b.y b.z  c.x c.y c.z  primitive
                            spheres, rows:   x y z radius, five rows unused,        primitive

`child` and `primitive` are int32, kept bit for bit in float32 cells. A child >= 0 is a node; a leaf is ~(2 p) for the
triangle packet p, ~(2 p + 1) for the sphere packet p. Node 0 is the root. A lane without a child has a box that nothing
hits (lower +inf, upper -inf); a lane without a primitive has NaN in all its cells. A primitive's number is its triangle's
index, or the number of triangles + its sphere's index.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy.typing as npt

__all__ = ["NODE_ROWS", "NODE_SIZE", "PACKET_ROWS", "PACKET_SIZE", "ROW_CHILD", "ROW_PRIMITIVE", "STACK_SIZE", "WIDTH", "Bvh"]

WIDTH = 8
NODE_ROWS = 7
ROW_CHILD = 6
PACKET_ROWS = 10
ROW_PRIMITIVE = 9
NODE_SIZE = NODE_ROWS * WIDTH
PACKET_SIZE = PACKET_ROWS * WIDTH

# The builder halves by number below depth 40, so no tree over 2**31 primitives is deeper than 40 + 31 - 3 levels; each puts
# at most seven children aside.
STACK_SIZE = 512


class Bvh(NamedTuple):
    """A bounding volume hierarchy: see the module's docstring."""

    node: npt.NDArray[Any]  # (N, 7, 8) f32
    packet: npt.NDArray[Any]  # (P, 10, 8) f32
