"""Deep pixels: exact sums of light and coverage by depth, which add up over batches, tiles and workers in any order.

The depth of a sample's first vertex is put into one of 1,024 bins per octave, by the bits of its float32. A pixel keeps, for each
bin that occurs, integer sums in the film's fixed point and the least and greatest depth. Where a pixel has more bins than
`Deep.most`, pairs of adjacent bins become one until there are few enough. The level, how often that happened, is the least one at
which the set of all bins is small enough. It is a property of the set, and never lower for a larger one: so parts may be merged,
and made coarser, in any order.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "CAUGHT",
    "COUNT",
    "FAR",
    "LIGHT",
    "MOST_DEEP",
    "MOST_LEVEL",
    "NEAR",
    "SUMS",
    "UNCOVERED",
    "Deep",
    "binned",
    "merged",
    "moved",
    "no_deep",
    "pixels_of",
]

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
U64 = npt.NDArray[np.uint64]

MOST_DEEP = 64  # greatest value of RenderSettings.deep
NEAR, FAR = np.float32(1e-10), np.float32(1e10)  # range of depths; FAR is that of the background
COUNT, UNCOVERED, CAUGHT = range(3)  # columns of Deep.sums: number of samples; see FirstHit in kernel/steps/record_first_hit.py
LIGHT = slice(3, 6)  # red, green, blue
SUMS = 6
_DROPPED_BITS = np.uint32(13)  # of the mantissa's 23
MOST_LEVEL = 18  # at which there is one bin
_PIXEL_BIT, _LEVEL_BIT = np.uint64(32), np.uint64(24)
_LEVEL_MASK, _BIN_MASK = np.uint64(255), np.uint64((1 << 24) - 1)


class Deep(NamedTuple):
    """The sums of the samples of each pixel by depth.

    most: greatest number of bins of a pixel. key: (n,) uint64, ascending, each once: the pixel's index << 32 | level of the pixel
    << 24 | bin. sums: (n, SUMS) int64; all but COUNT are in the film's fixed point. near, far: (n,) float32, the least and the
    greatest depth in the bin.
    """

    most: int
    key: U64
    sums: I64
    near: F32
    far: F32


def no_deep(most: int) -> Deep:
    """Returns empty sums."""
    return Deep(most, np.zeros(0, np.uint64), np.zeros((0, SUMS), np.int64), np.zeros(0, np.float32), np.zeros(0, np.float32))


def pixels_of(deep: Deep) -> I64:
    """Returns the pixel's index of each entry, (n,) int64, ascending."""
    return (deep.key >> _PIXEL_BIT).astype(np.int64)


def binned(most: int, pixel: I64, depth: F32, sums: I64) -> Deep:
    """Returns the sums of samples. pixel: (n,), their pixels' indices. depth: (n,). sums: (n, SUMS), of each sample alone."""
    depth = np.clip(depth, NEAR, FAR)
    bins = (depth.view(np.uint32) >> _DROPPED_BITS).astype(np.uint64)
    return _summed(Deep(most, pixel.astype(np.uint64) << _PIXEL_BIT | bins, sums, depth, depth))


def merged(parts: Iterable[Deep]) -> Deep:
    """Returns the sum of at least one Deep, such as those of different batches; their order has no effect on the result."""
    given = list(parts)
    known = [part for part in given if len(part.key)]
    if len(known) < 2:
        return known[0] if known else given[0]
    keys, sums, near, far = (np.concatenate(column) for column in zip(*(part[1:] for part in known), strict=True))
    return _summed(Deep(known[0].most, keys, sums, near, far))


def _summed(found: Deep) -> Deep:
    """Returns the sums by bin of entries in any order, whose keys may occur several times and with different levels."""
    if not len(found.key):
        return found
    pixels, which = np.unique(found.key >> _PIXEL_BIT, return_inverse=True)
    level = found.key >> _LEVEL_BIT & _LEVEL_MASK
    levels = np.zeros(len(pixels), np.uint64)
    np.maximum.at(levels, which, level)
    place = which.astype(np.uint64) << _LEVEL_BIT | (found.key & _BIN_MASK) >> levels[which] - level
    order = np.argsort(place, kind="stable")
    place = place[order]
    while True:
        is_first = np.concatenate([[True], place[1:] != place[:-1]])
        row = (place >> _LEVEL_BIT).astype(np.int64)
        is_crowded = np.bincount(row[is_first], minlength=len(pixels)) > found.most
        if not is_crowded.any():
            break
        levels[is_crowded] += np.uint64(1)
        at = np.flatnonzero(is_crowded[row])
        place[at] = place[at] & ~_BIN_MASK | (place[at] & _BIN_MASK) >> np.uint64(1)
    first = np.flatnonzero(is_first)
    row = row[first]
    return Deep(
        found.most,
        pixels[row] << _PIXEL_BIT | levels[row] << _LEVEL_BIT | place[first] & _BIN_MASK,
        np.add.reduceat(found.sums[order], first, axis=0),
        np.minimum.reduceat(found.near[order], first),
        np.maximum.reduceat(found.far[order], first),
    )


def moved(deep: Deep, x: int, y: int, width: int, frame_width: int) -> Deep:
    """Converts the sums of a tile from pixel indices in the tile to pixel indices in the frame.

    x, y: the tile's upper left corner in the frame. width, frame_width: widths of the tile and of the frame, in pixels.
    """
    place = pixels_of(deep)
    in_frame = ((y + place // width) * frame_width + x + place % width).astype(np.uint64)
    return deep._replace(key=in_frame << _PIXEL_BIT | deep.key & np.uint64(0xFFFFFFFF))
