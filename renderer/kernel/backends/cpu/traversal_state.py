"""The traversal state of a ray in its path's row: its initialisation for eight rays at a time, and the rays' stacks."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import MAX_LEVELS, WIDTH
from renderer.bvh.simd import load_int
from renderer.bvh.slabs import NEARER, margin_of, planes_of
from renderer.jit import device
from renderer.kernel.backends.cpu.rows import ROWS, Traversal, column, line_floats, scatter
from renderer.wide.values import as_wide, where

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
    "new_stacks",
    "start_traversal",
    "three",
    "word",
]

INVERSE, NEAR, FAR, AXES, SHEAR, ORIGIN = (
    column(Traversal, field) for field in ("inverse", "near", "far", "axis_x", "shear", "origin")
)
TOP, CHILD, PLANES, BEST, MARGIN = (column(Traversal, field) for field in ("top", "child", "plane_x", "best", "margin"))
OCCLUDED = BEST  # of a shadow ray

# The stack holds one entry a level and ray, those of all rays of one level side by side: rays are mostly on few levels. An entry:
# the keys of a node's children, the next of them, the node. Of a shadow ray: the children that are left, the node.
_ENTRY = 16  # words: a cache line
LEVEL = np.uintp((ROWS + 1) * _ENTRY)  # stride between levels; not a power of two, to avoid sharing cache sets
# After the stacks, results passed from one loop over rays to the next, two cache lines each: walk.py.
HELD, HELD_SIZE = LEVEL * np.uintp(MAX_LEVELS + 2), np.uintp(2 * _ENTRY)
STACK_SIZE = int(HELD) + ROWS * int(HELD_SIZE)
NEVER = np.int32(-(2**31))  # key of the sentinel below a ray's first entry

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-18)
_A, _B, _C = np.uint32(0), np.uint32(WIDTH), np.uint32(2 * WIDTH)
_1, _2 = np.uintp(1), np.uintp(2)


def new_stacks() -> npt.NDArray[np.float32]:
    """Returns the traversal stacks of all rows, with a sentinel below each ray's first entry."""
    stack = line_floats(STACK_SIZE)
    stack.view(np.int32)[WIDTH : int(LEVEL) : _ENTRY] = NEVER
    return stack


@device
def three(pool, place):
    """Returns three consecutive floats of the pool from a flat index on, as a vector."""
    return pool[place], pool[place + _1], pool[place + _2]


@device
def word(array, place):
    """Returns the integer at a flat index, as an array index."""
    return np.uintp(np.uint32(load_int(array, place)))


@device
def _inverse(d):
    """Returns 1/d for eight rays, f32x8. As in renderer/bvh/traverse.py, components near zero become +-1e-18."""
    size = abs(d)
    return _ONE / math.copysign(where(size < _TINY, _TINY, size), d)


@device
def _slab(o, inverse, margin):
    """Returns (1/d, constant of the near plane, constant of the far plane) of one axis for eight rays, f32x8 each."""
    inverse = inverse * NEARER
    near, far = planes_of(o, inverse, margin)
    return inverse, near, far


@device
def _planes(inverse, axis):
    """Returns the offset of the near planes' row in a node, u32x8."""
    lower = np.uint32(2 * WIDTH * axis)
    return where(inverse > _ZERO, as_wide(lower, inverse), np.uint32(lower + np.uint32(WIDTH)))


@device
def start_traversal(pool, rows, o, d, best, root):
    """Initialises the traversal of eight rays at a tree node.

    rows: u32x8; o, d: origins and directions, three f32x8 each; best: initial value of BEST or OCCLUDED, f32x8; root: the node's
    number, u32x8.
    """
    ix, iy, iz = _inverse(d[0]), _inverse(d[1]), _inverse(d[2])
    ax, ay, az = abs(d[0]), abs(d[1]), abs(d[2])
    first, second = ax > max(ay, az), ay > az
    a, b, c = (as_wide(_A, ix), as_wide(_B, ix), as_wide(_C, ix))
    scale = where(first, ix, where(second, iy, iz))
    margin = margin_of(o, scale)
    x, y, z = _slab(o[0], ix, margin), _slab(o[1], iy, margin), _slab(o[2], iz, margin)
    kx = where(first, b, where(second, c, a))
    ky = where(first, c, where(second, a, b))
    kz = where(first, a, where(second, b, c))
    sx = where(first, d[1], where(second, d[2], d[0])) * scale
    sy = where(first, d[2], where(second, d[0], d[1])) * scale
    ox = where(first, o[1], where(second, o[2], o[0]))
    oy = where(first, o[2], where(second, o[0], o[1]))
    oz = where(first, o[0], where(second, o[1], o[2]))
    near, far = (x[1], y[1], z[1]), (x[2], y[2], z[2])
    state = Traversal(
        (x[0], y[0], z[0]),
        near,
        rows * np.uint32(_ENTRY),
        root,
        far,
        _planes(x[0], 0),
        _planes(y[0], 1),
        _planes(z[0], 2),
        kx,
        ky,
        kz,
        (sx, sy, scale),
        (ox, oy, oz),
        best,
        margin,
    )
    scatter(pool, rows, state)
