"""The state of each ray's BVH traversal, stored in its path's row of the pool, and the rays' traversal stacks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import MAX_LEVELS, WIDTH
from renderer.bvh.simd import load_int
from renderer.bvh.slabs import ray_constants
from renderer.jit import device
from renderer.kernel.backends.cpu.rows import ROWS, Traversal, column, line_floats, scatter
from renderer.wide.values import as_wide

__all__ = [
    "AXES",
    "BEST",
    "CHILD",
    "FAR",
    "HELD",
    "HELD_SIZE",
    "INVERSE",
    "LEVEL",
    "MARGIN",
    "NEAR",
    "NEVER",
    "OCCLUDED",
    "ORIGIN",
    "PLANES",
    "SHEAR",
    "STACK_SIZE",
    "TOP",
    "load_index",
    "load_vector",
    "new_stacks",
    "start_traversal",
]

INVERSE, NEAR, FAR, AXES, SHEAR, ORIGIN = (
    column(Traversal, field) for field in ("inverse", "near", "far", "axis_x", "shear", "origin")
)
TOP, CHILD, PLANES, BEST, MARGIN = (column(Traversal, field) for field in ("top", "child", "plane_x", "best", "margin"))
OCCLUDED = BEST  # of a shadow ray

# The stack has one entry per level and ray. The entries of all rays on one level are adjacent, since most rays are on few levels.
# An entry: the keys of a node's children, the next key, the node. For a shadow ray: the remaining children, the node.
_ENTRY = 16  # words: a cache line
LEVEL = np.uintp((ROWS + 1) * _ENTRY)  # stride between levels; not a power of two, to avoid sharing cache sets
# After the stacks, results passed from one loop over rays to the next, two cache lines each: walk.py.
HELD, HELD_SIZE = LEVEL * np.uintp(MAX_LEVELS + 2), np.uintp(2 * _ENTRY)
STACK_SIZE = int(HELD) + ROWS * int(HELD_SIZE)
NEVER = np.int32(-(2**31))  # key of the sentinel below a ray's first entry

_WIDTH = np.uint32(WIDTH)
_1, _2 = np.uintp(1), np.uintp(2)


def new_stacks() -> npt.NDArray[np.float32]:
    """Returns the traversal stacks for all rows of the pool, with a sentinel below each ray's first entry."""
    stack = line_floats(STACK_SIZE)
    stack.view(np.int32)[WIDTH : int(LEVEL) : _ENTRY] = NEVER
    return stack


@device
def load_vector(pool, place):
    """Returns three consecutive floats of the pool, starting at the flat index `place`, as a vector."""
    return pool[place], pool[place + _1], pool[place + _2]


@device
def load_index(array, place):
    """Returns the integer at the flat index `place` of an array, as an unsigned integer that can index another array."""
    return np.uintp(np.uint32(load_int(array, place)))


@device
def start_traversal(pool, rows, o, d, best, root):
    """Initialises the traversal of eight rays at a tree node.

    rows: the paths' rows of the pool, u32x8. o, d: origins and directions, three f32x8 each. best: initial value of the columns
    BEST (closest distance) or OCCLUDED, f32x8. root: the node's number, u32x8.
    """
    ray = ray_constants(o, d, as_wide(_WIDTH, best))
    top = rows * np.uint32(_ENTRY)
    slabs = ray.inverse, ray.near, top, root, ray.far, *ray.planes
    scatter(pool, rows, Traversal(*slabs, *ray.axes, ray.shear, ray.origin, best, ray.margin))
