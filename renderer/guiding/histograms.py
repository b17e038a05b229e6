"""Makes a guide (renderer/arrays/guide.py) from records of pilot paths.

All sums are of integers, so neither the order of the records nor how they are divided changes a bit. A cell with few records
shares the histogram of a cube of twice its size, up to eight times; a bin with much light is divided into finer ones.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.arrays.guide import (
    BIN_WIDTH,
    BINS,
    BLOCK_WIDTH,
    CELL_WIDTH,
    CELLS_PER_UNIT,
    COUNT,
    FRAME_COLUMNS,
    LOW,
    NO_BLOCK,
    SIDE,
    SIDES,
    Guide,
    empty_guide,
    histogram_guide,
)

__all__ = ["Records", "arriving", "cells_of", "cubes_of", "frame_of", "guide_of", "integers", "squares", "sums"]

Records = npt.NDArray[np.float32]  # (n, RECORD_COLUMNS): renderer/kernel/guiding/pilot.py
I64 = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]

CUBES = 32  # along the longest side of the region of the records
_LEVELS = 4  # cubes of 1, 2, 4, 8 times that size
_ENOUGH = 512  # records with light for a histogram
# A bin is divided if it has this many records with light, and at least this fraction of the histogram's light (its reciprocal).
_ENOUGH_WITHIN = 64
_LEAST_SHARE = 64
_SHARE = 0.5  # probability of sampling the guide unless shares.py has learned another
_FLOOR = 10  # 1 / _FLOOR of the directions are uniform over the square
_UNITS = 1 << 20  # of the largest value
_OUTSIDE = 0.01  # records beyond these quantiles along an axis lie in the outermost cubes
_MOST = 0.99999  # quantile of the values with light at which larger ones are cut


def guide_of(paths: Records, photons: Records, flux: float) -> Guide:
    """Returns the guide made from records of camera paths and of photons; an empty one if there are too few with light.

    flux: the power of one photon. Both are estimates of the irradiance of a cell by directions, which are added: camera paths see
    the light that photons rarely bring, as that of the sky through a window, and photons that behind glass.
    """
    if len(paths) < _ENOUGH:
        return empty_guide()
    frame = frame_of(paths[:, :3])
    counts = frame[COUNT:].astype(np.int64)
    cubes, sides = cubes_of(paths[:, :3], frame), _sides(paths[:, 3:6])
    keys = _keys(cubes, counts, sides, 0)
    visits = np.bincount(keys, minlength=int(counts.prod()) * SIDES)
    value = arriving(paths, keys, len(visits)) / visits[keys]
    its_cubes, its_sides = cubes_of(photons[:, :3], frame), _sides(photons[:, 3:6])
    its_value = photons[:, 9].astype(np.float64) * (flux * float(frame[CELLS_PER_UNIT]) ** 2)
    its_value[visits[_keys(its_cubes, counts, its_sides, 0)] == 0] = 0  # where camera paths do not come
    value = np.concatenate((value, its_value))
    lit = value > 0
    if int(lit.sum()) < _ENOUGH:
        return empty_guide()
    cubes, sides = np.concatenate((cubes, its_cubes))[lit], np.concatenate((sides, its_sides))[lit]
    square = squares(np.concatenate((paths[:, 6:9], photons[:, 6:9]))[lit])
    return _build(frame, counts, cubes, sides, square, integers(value[lit])[0])


def integers(value: F64) -> tuple[I64, float]:
    """Returns (non-negative values as integers of at most _UNITS, the unit); the largest values are cut."""
    at = int(_MOST * (len(value) - 1))
    unit = float(np.partition(value, at)[at]) / _UNITS
    if not unit > 0:
        unit = float(value.max()) / _UNITS
    return np.ceil(np.minimum(value / unit, _UNITS)).astype(np.int64), unit


def arriving(records: Records, key: I64, cells: int) -> F64:
    """Returns the light, times cosine over density, that arrives at each record's vertex by its segment, (n,).

    key: the cell of each record. cells: their number. What the next vertex sends back by further bounces is the mean over all
    records of its cell: one path's own share of it is far noisier.
    """
    near, scale, indirect = (records[:, k].astype(np.float64) for k in (9, 10, 11))
    if indirect.any():
        units, unit = integers(indirect)
        mean = sums(key, units, cells) * unit / np.maximum(np.bincount(key, minlength=cells), 1)
        beyond = np.zeros(len(records))
        beyond[:-1] = mean[key[1:]]
        near = near + np.where(records[:, 12] > 0, beyond, 0.0)
    return near * scale


def frame_of(points: npt.NDArray[np.float32], cubes: int = CUBES) -> npt.NDArray[np.float32]:
    """Returns the frame of a grid over most of the points (n, 3), of `cubes` cubes along the longest side."""
    ends = int(_OUTSIDE * (len(points) - 1))
    ordered = np.partition(points, (ends, len(points) - 1 - ends), axis=0).astype(np.float64)
    low, high = ordered[ends], ordered[len(points) - 1 - ends]
    size = float((high - low).max()) / cubes
    if not size > 0:
        size = 1.0
    low, high = low - size / 2, high + size / 2
    frame = np.zeros(FRAME_COLUMNS, np.float32)
    frame[LOW : LOW + 3], frame[3] = low, 1 / size
    frame[COUNT:] = np.ceil((high - low) / size)
    return frame


def cubes_of(points: npt.NDArray[np.float32], frame: npt.NDArray[np.float32]) -> I64:
    """Returns the cubes of points, (n, 3), with the arithmetic of the kernel."""
    at = (points - frame[LOW : LOW + 3]) * frame[3]
    cubes: I64 = np.clip(at, np.float32(0), frame[COUNT:] - np.float32(1)).astype(np.int64)
    return cubes


def _sides(normals: npt.NDArray[np.float32]) -> I64:
    """Returns the sides of cubes for normals, (n,)."""
    x, y, z = normals.T
    by_x, by_y = (abs(x) >= abs(y)) & (abs(x) >= abs(z)), abs(y) >= abs(z)
    component = np.where(by_x, x, np.where(by_y, y, z))
    sides: I64 = np.where(by_x, 0, np.where(by_y, 2, 4)) + (component < 0)
    return sides


def cells_of(records: Records, frame: npt.NDArray[np.float32]) -> I64:
    """Returns the cells of records in a guide with this frame, (n,)."""
    counts = frame[COUNT:].astype(np.int64)
    return _keys(cubes_of(records[:, :3], frame), counts, _sides(records[:, 3:6]), 0)


def squares(directions: npt.NDArray[np.float32] | F64) -> I64:
    """Returns the bins of unit directions in a square of SIDE * SIDE bins along each axis, (n, 2)."""
    d = directions.astype(np.float64)
    x, y, z = (d / ((np.abs(d[:, 0]) + np.abs(d[:, 1])) + np.abs(d[:, 2]))[:, None]).T
    below = z < 0
    a, b = np.copysign(1 - np.abs(y), x), np.copysign(1 - np.abs(x), y)
    square = 0.5 + 0.5 * np.stack((np.where(below, a, x), np.where(below, b, y)), axis=1)
    bins: I64 = np.clip(square * BINS, 0, BINS - 1).astype(np.int64)
    return bins


def _build(frame: npt.NDArray[np.float32], counts: I64, cube: I64, side: I64, square: I64, units: I64) -> Guide:
    """Returns the guide of records with light: their cubes, sides, bins and integer values."""
    top = (square // SIDE) @ np.array([SIDE, 1])
    within = (square % SIDE) @ np.array([SIDE, 1])
    cell = np.full((*counts, SIDES), NO_BLOCK, np.int32)
    cdfs: list[npt.NDArray[np.float32]] = []
    children: list[npt.NDArray[np.int32]] = []
    blocks = 1  # the first is uniform
    cells = int(counts.prod()) * SIDES
    open_cells = np.flatnonzero(np.bincount(_keys(cube, counts, side, 0), minlength=cells))  # to be given a histogram
    for level in range(_LEVELS):
        keys = _keys(cube, counts, side, level)
        number = np.bincount(keys, minlength=cells)
        fine_cube, fine_side = _of_keys(open_cells, counts)
        wanted = _keys(fine_cube, counts, fine_side, level)
        good = number[wanted] >= _ENOUGH
        used = np.unique(wanted[good])
        if len(used):
            own = np.full(cells, -1, np.int64)
            own[used] = np.arange(len(used))
            mine = own[keys] >= 0
            made, its = _histograms(own[keys[mine]], top[mine], within[mine], units[mine], len(used), blocks)
            cdfs.append(made)
            children.append(its)
            x, y, z = fine_cube[good].T
            cell[x, y, z, fine_side[good]] = blocks + own[wanted[good]]
            blocks += len(made)
        open_cells = open_cells[~good]
    if blocks == 1:
        return empty_guide()
    empty = empty_guide()
    cdf = np.concatenate((empty.cdf.reshape(1, BLOCK_WIDTH), *cdfs))
    bins = np.stack((_densities(cdf), np.concatenate((empty.bin[None, :, 1], *children))), axis=2).astype(np.float32)
    table = np.stack((cell, np.where(cell == NO_BLOCK, 0, _SHARE)), axis=-1).astype(np.float32)
    return histogram_guide(frame, table.reshape(-1, CELL_WIDTH), cdf.reshape(-1), bins.reshape(-1, BIN_WIDTH))


def _densities(cdf: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Returns the densities of the bins of blocks relative to a uniform one, (n, BINS), with which their cdfs are sampled."""
    heights = np.diff(cdf[:, :SIDE], axis=1, prepend=np.float32(0))
    widths = np.diff(cdf[:, SIDE:].reshape(-1, SIDE, SIDE), axis=2, prepend=np.float32(0))
    densities: npt.NDArray[np.float32] = (heights[:, :, None] * widths * np.float32(BINS)).reshape(-1, BINS)
    return densities


def _keys(cube: I64, counts: I64, side: I64, level: int) -> I64:
    x, y, z = (cube >> level).T
    key: I64 = ((x * counts[1] + y) * counts[2] + z) * SIDES + side
    return key


def _of_keys(keys: I64, counts: I64) -> tuple[I64, I64]:
    """Returns (cubes (n, 3), sides (n,)) of the keys of level 0."""
    cube, side = np.divmod(keys, SIDES)
    rest, z = np.divmod(cube, counts[2])
    x, y = np.divmod(rest, counts[1])
    return np.stack((x, y, z), axis=1), side


def _histograms(
    own: I64, top: I64, within: I64, units: I64, count: int, first: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Returns (cdfs (blocks, BLOCK_WIDTH), children (blocks, BINS)) of `count` histograms, then those of their divided bins.

    own: the histogram of each record. top, within: its bin, and its bin within that. first: the number of the first block.
    """
    place = own * BINS + top
    mass = sums(place, units, count * BINS)
    number = np.bincount(place, minlength=count * BINS)
    total = np.repeat(mass.reshape(count, BINS).sum(axis=1), BINS)
    divided = np.flatnonzero((number >= _ENOUGH_WITHIN) & (mass * _LEAST_SHARE >= total))
    child = np.full(count * BINS, NO_BLOCK, np.int32)
    child[divided] = first + count + np.arange(len(divided))
    inner = np.full(count * BINS, -1, np.int64)
    inner[divided] = np.arange(len(divided))
    mine = inner[place] >= 0
    finer = sums(inner[place[mine]] * BINS + within[mine], units[mine], len(divided) * BINS)
    cdf = _cdf(np.concatenate((mass, finer)).reshape(-1, SIDE, SIDE))
    no_children = np.full((len(divided), BINS), NO_BLOCK, np.int32)
    return cdf, np.concatenate((child.reshape(count, BINS), no_children))


def sums(place: I64, units: I64, count: int) -> I64:
    """Returns the sums of integers by place, (count,): exact, since all are below 2**53."""
    return np.bincount(place, weights=units.astype(np.float64), minlength=count).astype(np.int64)


def _cdf(mass: I64) -> npt.NDArray[np.float32]:
    """Returns the blocks' cdfs, (n, BLOCK_WIDTH), of the light of their bins, (n, SIDE, SIDE), with a uniform part added."""
    total = mass.sum(axis=(1, 2), keepdims=True)
    weight = mass * (BINS * (_FLOOR - 1)) + np.maximum(total, 1)
    rows = weight.sum(axis=2).cumsum(axis=1).astype(np.float64)
    columns = weight.cumsum(axis=2).astype(np.float64)
    rows, columns = rows / rows[:, -1:], columns / columns[:, :, -1:]
    return np.concatenate((rows, columns.reshape(len(mass), BINS)), axis=1).astype(np.float32)
