"""Clusters of primitives: the non-empty cells of a grid.

The top of a tree is built over clusters, of which there are a hundredth as many as primitives, as in Garanzha, Pantaleoni &
McAllister, "Simpler and Faster HLBVH with Work Queues" (2011).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import clear, doubled_centroid, grow_by, number_of, numbered
from renderer.bvh.simd import extract, load, maximum, minimum, splat
from renderer.bvh.split import (
    BINS,
    SAH_DEPTH,
    STACK,
    bound_sides,
    cheapest_plane,
    fill_bins,
    new_bins,
    partition,
    set_up_bins,
)
from renderer.jit import entry
from renderer.threads import Team, parts_of

__all__ = ["JOB", "Clusters", "gathered", "single_cluster", "split_clusters"]

# A node that is still to be split: tree row, first primitive, count, first of its descendants' rows, depth,
# first cluster, end of its clusters.
JOB = 7
CELL_BITS = 15  # bits of a cell's number: a mesh's surface crosses about five thousand of so many cells
FEWEST = 32  # minimum number of clusters of a node: fewer offer too few planes to choose from
TREELET = 4096  # primitives: 128 kB of boxes, which fit a core's cache
_ALL_BINS = np.int64(BINS)  # in the type of split.py's bin numbers, so that nothing is compiled twice
_BELOW_ONE = np.float32(1.0 - 1e-6)
_ZERO = np.float32(0.0)

F32 = npt.NDArray[np.float32]
Integers = npt.NDArray[Any]


class Clusters(NamedTuple):
    """The boxes and members of C clusters, which together contain N primitives."""

    source: Any  # (N,) i32: the primitives, cluster by cluster
    box: Any  # (C, 8) f32: boxes.py, numbered by cluster
    first: Any  # (C,) i64, in `source`
    count: Any  # (C,) i64, of primitives
    weight: Any  # (C,) i64: the count by the heuristic, where an instance counts eight times


def single_cluster(source: Integers, whole: F32) -> Clusters:
    """Returns a single cluster with all primitives of `source`. whole: (8,), the bounds of these primitives."""
    count = np.array([len(source)])
    return Clusters(source, numbered(whole.reshape(1, 8).copy()), np.zeros(1, np.int64), count, count)


def gathered(box: F32, source: Integers, spread: F32, solids: int, team: Team) -> Clusters:
    """Groups primitives by the cells of a grid over the bounds of their doubled centroids, `spread` (8,).

    The order within a cell is preserved, so the clusters do not depend on the number of threads.
    """
    grid, shift, cells = _grid(spread)
    parts = parts_of(0, len(source), -(-len(source) // team.threads))
    cell = np.empty(len(source), np.uint16)
    whole = np.empty((len(parts), cells, 8), np.float32)
    tally = np.empty((len(parts), cells, 2), np.int32)
    team.each(
        lambda job: _assign_cells(box, source, *job[0], grid, *shift, solids, cell, *job[1:]),
        zip(parts, whole, tally, strict=True),
    )
    used = np.flatnonzero(tally[:, :, 0].sum(axis=0))
    count, weight = tally[:, used].sum(axis=0, dtype=np.int64).T.copy()
    first = np.cumsum(count) - count
    at = np.empty((len(parts), cells), np.int64)
    at[:, used] = first + np.cumsum(tally[:, used, 0], axis=0) - tally[:, used, 0]
    sorted_ = np.empty_like(source)
    team.each(lambda job: _sort(source, cell, *job[0], job[1], sorted_), zip(parts, at, strict=True))
    return Clusters(sorted_, numbered(whole[:, used].max(axis=0)), first, count, weight)


def _grid(spread: F32) -> tuple[F32, tuple[int, int], int]:
    """Returns a grid of nearly cubical cells over a box: (grid, bit shifts, number of cells).

    spread: the box, (8,): the negated lower corner in elements 0 to 2, the upper corner in 4 to 6. grid: (3, 8) with x, y and z
    in columns 4 to 6; its rows are the origin, the cells per unit of length, and the index of the last cell. bit shifts: of the y
    and of the z index of a cell in the cell's number.
    """
    extent = (spread[4:7] + spread[:3]).astype(np.float64)
    bits = [0, 0, 0]
    for _ in range(CELL_BITS):
        bits[int(np.argmax(np.ldexp(extent, np.negative(bits))))] += 1
    grid = np.zeros((3, 8), np.float32)
    grid[0, 4:7] = -spread[:3]
    with np.errstate(divide="ignore", over="ignore"):
        scale = np.float32(_BELOW_ONE) * np.ldexp(np.float32(1.0), bits).astype(np.float32) / extent.astype(np.float32)
    grid[1, 4:7] = np.where(np.isfinite(scale), scale, 0.0)
    grid[2, 4:7] = np.ldexp(1.0, bits) - 1.0
    return grid, (bits[0], bits[0] + bits[1]), 1 << CELL_BITS


def split_clusters(clusters: Clusters, node: Integers, spread: F32, least: int, tree_box: F32, tree: Integers) -> Integers:
    """Splits a node over clusters until each part has at most `least` primitives or too few clusters to split.

    Splits at least once if a plane divides the node. Returns the parts, (J, JOB) i64. node: (JOB,) i64. spread: (8,), the bounds
    of the clusters' doubled centroids. Reorders the clusters' boxes, whose numbers identify a part's clusters. Writes the tree
    rows above the parts and the boxes of these rows, but not the primitive numbers in the boxes.
    """
    stack, spreads = np.empty((STACK, JOB), np.int64), np.empty((STACK, 8), np.float32)
    stack[0], spreads[0] = node, spread
    parts = np.empty((len(clusters.box), JOB), np.int64)
    return parts[: _split(clusters, new_bins(), spreads, stack, least, tree_box, tree, parts)]


@entry
def _assign_cells(box, source, first, end, grid, shift_y, shift_z, solids, cell, whole, tally):
    """Assigns primitives source[first : end] to grid cells, and computes each cell's bounds, number of primitives and weight.

    cell: receives each primitive's cell. tally: (cells, 2), receives the number and the weight of each cell's primitives. whole:
    receives the cells' bounds.
    """
    for c in range(len(whole)):
        clear(whole, c)
        tally[c, 0] = 0
        tally[c, 1] = 0
    lower, scale, last = load(grid, np.uintp(0)), load(grid, np.uintp(8)), load(grid, np.uintp(16))
    for k in range(first, end):
        i = np.uintp(source[k])
        row = load(box, i * np.uintp(8))
        place = maximum(minimum((doubled_centroid(row) - lower) * scale, last), splat(_ZERO))
        x = np.int64(extract(place, np.uint32(4)))
        y = np.int64(extract(place, np.uint32(5)))
        z = np.int64(extract(place, np.uint32(6)))
        c = np.uintp(x + (y << shift_y) + (z << shift_z))
        cell[k] = np.uint16(c)
        grow_by(whole, c, row)
        tally[c, 0] += 1
        tally[c, 1] += 1 if number_of(box, i) < solids else 8


@entry
def _sort(source, cell, first, end, at, target):
    """Writes primitives source[first : end] into `target`, grouped by cell (counting sort).

    at: the next free index of each cell, which is advanced.
    """
    for k in range(first, end):
        c = np.uintp(cell[k])
        target[np.uintp(at[c])] = source[k]
        at[c] += 1


@entry
def _split(clusters, bins, spread, stack, least, tree_box, tree, parts):
    """Implements `split_clusters`; returns the number of parts."""
    box = clusters.box
    top, found = 1, 0
    is_first = True
    while top > 0:
        top -= 1
        node, first, count, rows, depth = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3], stack[top, 4]
        begin, end = stack[top, 5], stack[top, 6]
        axis, bin = -1, 0
        if depth < SAH_DEPTH and (is_first or (count > least and end - begin >= FEWEST)):
            set_up_bins(bins.grid, spread, top, _ALL_BINS)
            fill_bins(bins, box, begin, end, _ALL_BINS, 0, clusters.weight)
            plane = cheapest_plane(bins, _ALL_BINS)
            axis, bin = plane.axis, plane.bin
        is_first = False
        if axis < 0:
            for k in range(JOB):
                parts[found, k] = stack[top, k]
            found += 1
            continue
        bound_sides(bins, axis, bin, _ALL_BINS, tree_box, rows)
        right, left = top, top + 1  # on the stack, the left one on top
        middle = partition(box, begin, end, bins.grid, axis, bin, spread, left, right)
        below = 0
        for c in range(begin, middle):
            below += clusters.count[number_of(box, c)]
        tree[node, 0] = rows
        tree[node, 1] = first
        tree[node, 2] = count
        stack[right, 0] = rows + 1
        stack[right, 1] = first + below
        stack[right, 2] = count - below
        stack[right, 3] = rows + 2 * below
        stack[right, 4] = depth + 1
        stack[right, 5] = middle
        stack[right, 6] = end
        stack[left, 0] = rows
        stack[left, 1] = first
        stack[left, 2] = below
        stack[left, 3] = rows + 2
        stack[left, 4] = depth + 1
        stack[left, 5] = begin
        stack[left, 6] = middle
        top += 2
    return found
