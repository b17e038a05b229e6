"""The layout of a path guide: the distribution of incident light, by cells of the scene, in the form that kernels read.

Space is divided into a regular grid of cubes, and each cube into six sides by the largest component of the surface normal. A
cell, one side of a cube, refers to a histogram of directions, or to none. Directions are the unit square (octahedral map,
renderer/kernel/sampling/octahedron.py), divided into SIDE x SIDE bins; a bin with much light is divided once more by a block of
its own. Block 0 is uniform: it stands for no histogram, and for no division, so that a density is a product of two bins without
a branch. Numbers of blocks are stored as floats beside what is read with them.

A guide has either histograms or portals: spheres that a large part of the light crosses in all of the region, as at a door or a
window. Then a cube has the radiance that is seen through each of them, in addition to the radiance from other directions.
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
    "MOST_PORTALS",
    "NO_BLOCK",
    "OTHER_RADIANCE",
    "PORTAL_CENTER",
    "PORTAL_COLUMNS",
    "PORTAL_RADIUS",
    "RADIANCE_COLUMNS",
    "SIDE",
    "SIDES",
    "Guide",
    "empty_guide",
    "histogram_guide",
    "portal_guide",
]

SIDE = 8  # bins along each axis of a block
BINS = SIDE * SIDE
BLOCK_WIDTH = SIDE + BINS  # the cdf of the rows of bins, then that within each row; each without its first 0
SIDES = 6  # of a cube: the axis of the normal's largest component times two, plus one if that is negative
NO_BLOCK = 0
CELL_WIDTH = 2  # columns of `cell`: its block, or NO_BLOCK; the probability of sampling the block's histogram
BIN_WIDTH = 2  # columns of `bin`: its density relative to a uniform one within its block; the block that divides it, or NO_BLOCK
PORTAL_CENTER, PORTAL_RADIUS = 0, 3  # columns of `portal`
PORTAL_COLUMNS = 4
MOST_PORTALS = 8  # at each vertex all of them are evaluated
OTHER_RADIANCE = MOST_PORTALS  # column of `radiance`: of directions through no portal; before it, one column for each portal
RADIANCE_COLUMNS = MOST_PORTALS + 1
LOW, CELLS_PER_UNIT, COUNT = 0, 3, 4  # columns of `frame`
FRAME_COLUMNS = 7

Array = npt.NDArray[Any]


class Guide(NamedTuple):
    """The tables of a guide, read-only."""

    frame: Array  # (FRAME_COLUMNS,) f32: lower corner 3, cubes per unit length, number of cubes along x, y, z
    cell: Array  # (cubes * SIDES, CELL_WIDTH) f32; x is the slowest axis, then y, z, side
    cdf: Array  # (blocks * BLOCK_WIDTH,) f32, each part ends with 1
    bin: Array  # (blocks * BINS, BIN_WIDTH) f32; rows of bins one after the other
    portal: Array  # (portals, PORTAL_COLUMNS) f32; none in a guide of histograms
    radiance: Array  # (cubes, RADIANCE_COLUMNS) f32, in the order of `cell`; one row in a guide of histograms


def empty_guide() -> Guide:
    """Returns a guide of one cell without a histogram: paths sample the BSDF alone."""
    frame = np.zeros(FRAME_COLUMNS, np.float32)
    frame[COUNT:] = 1
    steps = np.arange(1, SIDE + 1, dtype=np.float32) / np.float32(SIDE)
    uniform = np.zeros((BINS, BIN_WIDTH), np.float32)
    uniform[:, 0] = 1
    return histogram_guide(frame, np.zeros((SIDES, CELL_WIDTH), np.float32), np.tile(steps, 1 + SIDE), uniform)


def histogram_guide(frame: Array, cell: Array, cdf: Array, bins: Array) -> Guide:
    """Returns a guide of histograms."""
    none = np.zeros((0, PORTAL_COLUMNS), np.float32), np.zeros((1, RADIANCE_COLUMNS), np.float32)
    return _read_only(Guide(frame, cell, cdf, bins, *none))


def portal_guide(frame: Array, portal: Array, radiance: Array) -> Guide:
    """Returns a guide of portals."""
    return _read_only(empty_guide()._replace(frame=frame, portal=portal, radiance=radiance))


def _read_only(guide: Guide) -> Guide:
    for array in guide:
        array.flags.writeable = False
    return guide
