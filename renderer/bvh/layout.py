"""The arrays of a built BVH, shared by the builder and the traversal.

An 8-wide tree. A node stores its eight children's boxes lane by lane, so that a ray is tested against all eight in a few
instructions. A leaf is one packet of up to eight triangles, spheres or curve segments, also stored lane by lane, or one instance.
There may be unreferenced nodes and packets between the others.

    node           (N, 7, 8) f32   rows: x lower, x upper, y lower, y upper, z lower, z upper, child
    packet         (P, 10, 8) f32  triangles, rows: a.x a.y a.z  b.x b.y b.z  c.x c.y c.z  primitive
                                   spheres, rows:   x y z radius, five rows unused,        primitive
                                   curves, rows:    a.x a.y a.z  b.x b.y b.z  radius at a, at b, reach,  primitive
    instance_root  (I,) i32        the root node of each instance's tree
    to_local       (I, 3, 4) f64   from world space to the instance's space: a matrix and, last column, a translation
    motion           (R, 18) f64   keys of instances that move while the shutter is open (motion.py); replaces their to_local
    instance_motion  (I, 2) i32    first key and number of keys of each instance, 0 if static; no rows if all are
    keyed_packets    (2,) i32      the first packet with moving vertices or spheres, and the number of its keys
    ray_roots        (r,) i32      the root nodes for camera rays and for shadow rays (ray_masks.py); other rays start at 0,
                                   unless there are more: for diffuse, glossy, transmission and volume rays
                                   (RAY_KINDS), then one for the shadow rays of each shadow link

`child` and `primitive` are int32, stored bit for bit in float32 cells. A child >= 0 is a node; a leaf is ~(4 p) for the
triangle packet p, ~(4 p + 1) for the sphere packet p, ~(4 i + 2) for the instance i, ~(4 p + 3) for the packet p of curve
segments. Node 0 is the world's root. A lane
without a child has an empty box (lower +inf, upper -inf); a lane without a primitive has NaN in all its cells. A
primitive's number is its triangle's index, or the number of triangles + its sphere's index. A curve segment is a row of the
triangles whose second and third vertex are the same: it extends from the first to the second (renderer/bvh/curves.py, where the
sign of a radius and the reach are explained).

A packet with K keys is stored as K consecutive packets, and its leaf refers to the first. Vertices are interpolated linearly
between two keys. Packets with keys belong to the world's tree, and come last. Boxes bound the whole motion.

Instances form exactly two levels. Several instances share one tree, which is in its own space and contains triangles and curves
only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "CURVES",
    "INSTANCE",
    "KEY_COLUMNS",
    "LEAF_KIND",
    "MAX_LEVELS",
    "NEVER",
    "NODE_ROWS",
    "NODE_SIZE",
    "PACKET_ROWS",
    "PACKET_SIZE",
    "PAGE",
    "RAY_KINDS",
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
KEY_COLUMNS = 18  # of `motion`: motion.py
NEVER = 2**31 - 1  # an invalid packet number
PAGE = 4096  # bytes: alignment of parts of arrays, so that files of them can be mapped consecutively
TRIANGLES, SPHERES, INSTANCE, CURVES = range(4)  # the kinds of leaves
LEAF_KIND = 3  # mask of the kind in the number of a leaf
RAY_KINDS = ("camera", "shadow", "diffuse", "glossy", "transmission", "volume")  # a ray's kind is an index

# The builder splits in halves below depth 40, so no tree over 2**31 primitives is deeper than 40 + 31 - 3 levels; each pushes
# at most seven children. A world's tree may have a tree as its top (subtrees.py), with fewer than 2**20 instances:
# over trees of together 2**25 primitives, 57 + 62 levels at most.
MAX_LEVELS = 119
STACK_SIZE = 512


class Bvh(NamedTuple):
    """A bounding volume hierarchy; the module's docstring describes the arrays."""

    node: npt.NDArray[Any]  # (N, 7, 8) f32
    packet: npt.NDArray[Any]  # (P, 10, 8) f32
    instance_root: npt.NDArray[Any]  # (I,) i32
    to_local: npt.NDArray[Any]  # (I, 3, 4) f64
    motion: npt.NDArray[Any] = np.zeros((0, KEY_COLUMNS))  # (R, KEY_COLUMNS) f64
    instance_motion: npt.NDArray[Any] = np.zeros((0, 2), np.int32)  # (I or 0, 2) i32
    keyed_packets: npt.NDArray[Any] = np.array([NEVER, 1], np.int32)  # (2,) i32
    ray_roots: npt.NDArray[Any] = np.zeros(2, np.int32)  # (2 or more,) i32; None: all rays start at node 0
    instances: Any = True  # None: the kernel has no instances (renderer/arrays/scene_features.py)
    curves: Any = None  # True: the kernel intersects curve segments; likewise
    compressed: Any = None  # a CompressedTree (compressed_tree.py) in place of `node` and `packet`, on graphics cards
