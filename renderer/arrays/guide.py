"""The layout of a path guide: the distribution of incident light, by cells of the scene, in the form that kernels read.

Space is divided into a regular grid of cubes, and each cube into six sides by the largest component of the surface normal. A
cell, one side of a cube, refers to a histogram of directions, or to none. Directions are the unit square (octahedral map,
renderer/kernel/sampling/octahedron.py), divided into SIDE x SIDE bins; a bin with much light is divided once more by a block of
its own. Block 0 is uniform: it stands for no histogram, and for no division, so that a density is a product of two bins without
a branch. Numbers of blocks are stored as floats beside what is read with them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "BINS",
    "BIN_WIDTH",
    "BLOCK_WIDTH",
    "CELLS_PER_UNIT",
    "CELL_WIDTH",
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
NO_BLOCK = 0
CELL_WIDTH = 2  # columns of `cell`: its block, or NO_BLOCK; the probability of sampling the block's histogram
BIN_WIDTH = 2  # columns of `bin`: its density relative to a uniform one within its block; the block that divides it, or NO_BLOCK
LOW, CELLS_PER_UNIT, COUNT = 0, 3, 4  # columns of `frame`
FRAME_COLUMNS = 7

Array = npt.NDArray[Any]


class Guide(NamedTuple):
    """The tables of a guide, read-only."""

    frame: Array  # (FRAME_COLUMNS,) f32: lower corner 3, cubes per unit length, number of cubes along x, y, z
    cell: Array  # (cubes * SIDES, CELL_WIDTH) f32; x is the slowest axis, then y, z, side
    cdf: Array  # (blocks * BLOCK_WIDTH,) f32, each part ends with 1
    bin: Array  # (blocks * BINS, BIN_WIDTH) f32; rows of bins one after the other


def empty_guide() -> Guide:
    """Returns a guide of one cell without a histogram: paths sample the BSDF alone."""
    frame = np.zeros(FRAME_COLUMNS, np.float32)
    frame[COUNT:] = 1
    steps = np.arange(1, SIDE + 1, dtype=np.float32) / np.float32(SIDE)
    uniform = np.zeros((BINS, BIN_WIDTH), np.float32)
    uniform[:, 0] = 1
    return read_only(frame, np.zeros((SIDES, CELL_WIDTH), np.float32), np.tile(steps, 1 + SIDE), uniform)


def read_only(*arrays: Array) -> Guide:
    """Returns a Guide of these arrays, after making them read-only."""
    for array in arrays:
        array.flags.writeable = False
    return Guide(*arrays)
