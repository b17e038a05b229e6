"""The layout of a path guide: the distribution of incident light, by cells of the scene, in the form that kernels read.

Space is divided into a regular grid of cubes, and each cube into six sides by the largest component of the surface normal. A
cell, one side of a cube, refers to a histogram of directions, or to none. Directions are the unit square (octahedral map,
renderer/kernel/sampling/octahedron.py), divided into SIDE x SIDE bins; a bin with much light is divided once more by a block of
its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "BINS",
    "BLOCK_WIDTH",
    "CELLS_PER_UNIT",
    "COUNT",
    "FRAME_COLUMNS",
    "LOW",
    "NO_BLOCK",
    "SIDE",
    "SIDES",
    "Guide",
    "empty_guide",
    "read_only",
]

SIDE = 8  # bins along each axis of a block
BINS = SIDE * SIDE
BLOCK_WIDTH = SIDE + BINS  # the cdf of the rows of bins, then that within each row; each without its first 0
SIDES = 6  # of a cube: the axis of the normal's largest component times two, plus one if that is negative
NO_BLOCK = -1
LOW, CELLS_PER_UNIT, COUNT = 0, 3, 4  # columns of `frame`
FRAME_COLUMNS = 7

Array = npt.NDArray[Any]


class Guide(NamedTuple):
    """The tables of a guide, read-only."""

    frame: Array  # (FRAME_COLUMNS,) f32: lower corner 3, cubes per unit length, number of cubes along x, y, z
    cell: Array  # (cubes * SIDES,) i32: the block of the cell's histogram, or NO_BLOCK; x is the slowest axis, then y, z, side
    cdf: Array  # (blocks * BLOCK_WIDTH,) f32, each part ends with 1
    share: Array  # (blocks,) f32: probability of sampling the histogram that begins with the block, 0 ... 1, below 1
    child: Array  # (blocks * BINS,) i32: the block that divides a bin, or NO_BLOCK; rows of bins one after the other


def empty_guide() -> Guide:
    """Returns a guide of one cell without a histogram: paths sample the BSDF alone."""
    frame = np.zeros(FRAME_COLUMNS, np.float32)
    frame[COUNT:] = 1
    none = np.zeros(0, np.float32)
    return read_only(frame, np.full(SIDES, NO_BLOCK, np.int32), none, none.copy(), np.zeros(0, np.int32))


def read_only(*arrays: Array) -> Guide:
    """Returns a Guide of these arrays, after making them read-only."""
    for array in arrays:
        array.flags.writeable = False
    return Guide(*arrays)
