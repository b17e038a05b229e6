"""Builds the binary tree under the BVH: binned splits by the surface area heuristic (SAH).

After Wald, "On fast construction of SAH-based bounding volume hierarchies" (2007). A node's primitives are put into bins by their
centroids along each axis; a sweep over the bins finds the cheapest plane between two bins; the primitives are partitioned by it.

The descendants of a node of n primitives have 2 n - 2 reserved rows of the tree, filled from the front. Therefore threads that
split different parts of one tree (top.py) need no synchronisation.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.boxes import (
    bound,
    clear,
    doubled_centroid,
    exchange,
    first_kind,
    grow,
    grow_by,
    half_area,
    last_kind,
    number_of,
)
from renderer.bvh.layout import INSTANCE
from renderer.bvh.simd import extract, load, maximum, minimum, select, splat, store
from renderer.jit import device, entry

__all__ = [
    "BINS",
    "SAH_DEPTH",
    "STACK",
    "Bins",
    "Plane",
    "bound_sides",
    "cheapest_plane",
    "fill_bins",
    "partition",
    "set_up_bins",
    "split",
]

BINS = 16
SAH_DEPTH = 40  # below this depth ranges are halved: see STACK_SIZE in layout.py
_FEW_BINS = 8
_MAX_FOR_FEW_BINS = 24  # number of primitives up to which few bins find an equally good plane
_LEAST_BINS = 4  # for nodes that fit a leaf
_NODE_COST = np.float32(0.2)  # cost of one binary level, in units of a packet test; measured on meshes and on Cornell boxes
_LEAF_SIZE = 8
STACK = 128  # pending nodes: at most one per level

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_NOTHING = np.float32(-np.inf)
_BELOW_ONE = np.float32(1.0 - 1e-6)  # so that the greatest centroid falls into the last bin


class Bins(NamedTuple):
    """The SAH bins of one node for all three axes; the arrays are reused for every node."""

    box: Any  # (3 * BINS, 8) f32; if fewer are used, those of the next axis follow immediately
    count: Any  # (3 * BINS,) i64, of primitives; an instance counts for eight
    grid: (
        Any  # (2, 8) f32, lanes 4 ... 6: where an axis' first bin begins; bins per length, 0 where all centroids are in one plane
    )
    right_cost: Any  # (BINS,) f32, of bin b and all to the right of it


class Plane(NamedTuple):
    """The split plane of a node: before bin `bin` along `axis`. axis -1: no split."""

    axis: int
    bin: int
    cost: float  # of both sides, in packet tests times half their areas


def new_bins() -> Bins:
    """Allocates one thread's bins."""
    return Bins(
        np.empty((3 * BINS, 8), np.float32),
        np.empty(3 * BINS, np.int64),
        np.zeros((2, 8), np.float32),
        np.empty(BINS, np.float32),
    )


@device
def set_up_bins(grid, spread, i, bins):
    """Sets up equal bins along each axis, from the smallest centroid to the largest.

    spread: row i contains the bounds of the centroids.
    """
    for k in range(4, 7):
        grid[0, k] = -spread[i, k - 4]
        scale = np.float32(bins) * _BELOW_ONE / (spread[i, k] + spread[i, k - 4])
        # An extent of 0, or so small that its reciprocal overflows, is not divided.
        grid[1, k] = scale if np.isfinite(scale) else _ZERO


@device
def _grid_position(row, grid, last):
    """Returns a box's coordinates in the grid of bins, from its centroid: lanes 4, 5 and 6 for x, y and z, not yet truncated.

    row: the box, an f32x8. last: the greatest coordinate.
    """
    place = (doubled_centroid(row) - load(grid, np.uintp(0))) * load(grid, np.uintp(8))
    return maximum(minimum(place, last), splat(_ZERO))


@device
def fill_bins(bins, box, first, end, used, solids, weights):
    """Adds boxes first ... end - 1 to the bins of each of the three axes. used: number of bins per axis.

    weights: number of primitives for which a box counts, by box number; None: 1, or 8 for box numbers from `solids` on.
    """
    for b in range(3 * used):
        clear(bins.box, b)
        bins.count[b] = 0
    last = splat(np.float32(used - 1))
    for i in range(first, end):
        row = load(box, np.uintp(i * 8))
        place = _grid_position(row, bins.grid, last)
        number = number_of(box, i)
        if weights is None:
            weight = 1 if number < solids else 8
        else:
            weight = weights[np.uintp(number)]
        x = np.uintp(np.int64(extract(place, np.uint32(4))))
        y = np.uintp(np.int64(extract(place, np.uint32(5))) + used)
        z = np.uintp(np.int64(extract(place, np.uint32(6))) + 2 * used)
        grow_by(bins.box, x, row)
        grow_by(bins.box, y, row)
        grow_by(bins.box, z, row)
        bins.count[x] += weight
        bins.count[y] += weight
        bins.count[z] += weight


@device
def _cost(box, count):
    """Returns the SAH cost of the packets needed for `count` primitives in a box; infinite for count 0."""
    return half_area(box) * np.float32((count + 7) >> 3) if count > 0 else _INF


@device
def cheapest_plane(bins, used):
    """Returns the Plane of lowest SAH cost between two of the `used` bins."""
    best_axis, best_bin, best_cost = -1, 0, _INF
    for axis in range(3):
        if bins.grid[1, 4 + axis] == _ZERO:
            continue
        first = axis * used
        side, count = splat(_NOTHING), 0
        for b in range(used - 1, 0, -1):
            side = maximum(side, load(bins.box, np.uintp((first + b) * 8)))
            count += bins.count[first + b]
            bins.right_cost[b] = _cost(side, count)
        side, count = splat(_NOTHING), 0
        for b in range(1, used):
            side = maximum(side, load(bins.box, np.uintp((first + b - 1) * 8)))
            count += bins.count[first + b - 1]
            cost = _cost(side, count) + bins.right_cost[b]
            if cost < best_cost:
                best_cost, best_axis, best_bin = cost, axis, b
    return Plane(best_axis, best_bin, best_cost)


@device
def bound_sides(bins, axis, bin, used, tree_box, rows):
    """Writes the bounds of the primitives on either side of a split plane into rows `rows` and `rows` + 1 of tree_box."""
    clear(tree_box, rows)
    clear(tree_box, rows + 1)
    for b in range(used):
        grow(tree_box, rows if b < bin else rows + 1, bins.box, axis * used + b)


@device
def partition(box, first, end, grid, axis, bin, spread, left, right):
    """Partitions boxes first ... end - 1 by a plane; returns the index where the right side begins.

    Rows left and right of `spread` receive the bounds of the doubled centroids of either side. Every box is swapped with the
    first one of the right side, even if unnecessary: a branch that is mispredicted half of the time would cost more.
    """
    lower, scale = grid[0, 4 + axis], grid[1, 4 + axis]
    limit = np.float32(bin)
    nothing = splat(_NOTHING)
    of_left, of_right = nothing, nothing
    low = np.uintp(axis)
    high = np.uintp(4 + axis)
    middle = first
    for i in range(first, end):
        is_left = (box[np.uintp(i), high] - box[np.uintp(i), low] - lower) * scale < limit
        centroid = doubled_centroid(load(box, np.uintp(i * 8)))
        of_left = maximum(select(is_left, centroid, nothing), of_left)
        of_right = maximum(select(is_left, nothing, centroid), of_right)
        exchange(box, i, middle)
        middle += np.int64(is_left)
    store(spread, np.uintp(left * 8), of_left)
    store(spread, np.uintp(right * 8), of_right)
    return middle


@device
def _partition_by_kind(box, first, end, kind, curves, triangles, solids):
    """Partitions boxes by kind of primitive, the given kind to the left; returns the index where the other kinds begin."""
    middle = first
    for i in range(first, end):
        if last_kind(box, i, curves, triangles, solids) == kind:
            exchange(box, i, middle)
            middle += 1
    return middle


@device
def _copy_boxes(box, clusters, begin, end, local, spread, tree_box, node):
    """Copies the boxes of all primitives in clusters begin ... end - 1 to `local`; writes their bounds to the node's box."""
    nothing = splat(_NOTHING)
    whole, centroids = nothing, nothing
    at = np.uintp(0)
    for i in range(begin, end):
        c = number_of(clusters.box, i)
        first = clusters.first[c]
        for k in range(first, first + clusters.count[c]):
            row = load(box, np.uintp(clusters.source[k]) * np.uintp(8))
            store(local, at, row)
            whole = maximum(row, whole)
            centroids = maximum(doubled_centroid(row), centroids)
            at += np.uintp(8)
    store(tree_box, np.uintp(node * 8), whole)
    store(spread, np.uintp(0), centroids)


@entry
def split(box, clusters, parts, local, bins, spread, stack, curves, triangles, solids, order, tree_box, tree):
    """Splits parts of a tree (from clusters.py) until every leaf is a packet of one kind, or one instance.

    tree: rows of (left child or -1, first index in `order`, count); the right child follows the left. tree_box: the nodes' boxes.
    stack: (STACK, 4) i64, pending nodes: node, first box, end and depth. spread: (STACK, 8) f32, the bounds of the pending nodes'
    doubled centroids. local: scratch for the boxes of the largest part.
    """
    for p in range(len(parts)):
        root, base, length, rows = parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3]
        _copy_boxes(box, clusters, parts[p, 5], parts[p, 6], local, spread, tree_box, root)
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = root, 0, length, parts[p, 4]
        top = 1
        while top > 0:
            top -= 1
            node, first, end, depth = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
            count = end - first
            tree[node, 0] = -1
            tree[node, 1] = base + first
            tree[node, 2] = count
            if count == 1:
                continue

            plane = Plane(-1, 0, _INF)
            used = BINS if count > _MAX_FOR_FEW_BINS else (_FEW_BINS if count > _LEAF_SIZE else _LEAST_BINS)
            if depth < SAH_DEPTH:
                set_up_bins(bins.grid, spread, top, used)
                fill_bins(bins, local, first, end, used, solids, None)
                plane = cheapest_plane(bins, used)
            least = first_kind(tree_box, node, curves, triangles, solids)
            most = last_kind(tree_box, node, curves, triangles, solids)
            fits = count <= _LEAF_SIZE and least == most and most != INSTANCE
            area = half_area(load(tree_box, np.uintp(node * 8)))
            if fits and (plane.axis < 0 or area * (_ONE - _NODE_COST) <= plane.cost):
                continue

            right, left = top, top + 1  # on the stack: the left one is next
            if least != most and count <= _LEAF_SIZE:
                middle = _partition_by_kind(local, first, end, least, curves, triangles, solids)
            elif plane.axis >= 0:
                bound_sides(bins, plane.axis, plane.bin, used, tree_box, rows)
                middle = partition(local, first, end, bins.grid, plane.axis, plane.bin, spread, left, right)
            else:
                middle = first + count // 2
            if plane.axis < 0 or (least != most and count <= _LEAF_SIZE):
                for side in range(2):
                    bound(local, middle if side else first, end if side else middle, tree_box, rows + side, spread, left - side)
            tree[node, 0] = rows
            stack[left, 0], stack[left, 1], stack[left, 2], stack[left, 3] = rows, first, middle, depth + 1
            stack[right, 0], stack[right, 1], stack[right, 2], stack[right, 3] = rows + 1, middle, end, depth + 1
            rows += 2
            top += 2
        for i in range(length):
            order[base + i] = number_of(local, i)
