"""The binary tree under the BVH: primitives split by the surface area heuristic, in bins.

After Wald, "On fast construction of SAH-based bounding volume hierarchies" (2007). A node's primitives are put into bins by their
centroids along each axis; a sweep over the bins finds the cheapest plane between two; the primitives are partitioned by it.
Boxes are kept as (-lower, upper), so that one 8-lane maximum grows one by another.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.fold import half_area
from renderer.bvh.layout import INSTANCE, SPHERES, TRIANGLES
from renderer.bvh.simd import load, maximum, store
from renderer.jit import builder, device

__all__ = ["split"]

_BINS = 16
_SAH_DEPTH = 40  # below, ranges are halved: see STACK_SIZE in layout.py
_NODE_COST = np.float32(0.2)  # of one binary level, in units of one packet's test; measured on meshes and on Cornell boxes
_LEAF_SIZE = 8

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_NOTHING = np.float32(-np.inf)
_WITHIN = np.float32(_BINS * (1.0 - 1e-6))  # the greatest centroid still falls into the last bin


class _Bins(NamedTuple):
    """One node's bins, those of an axis after those of another; its arrays are used again for every node."""

    box: Any  # (3 * _BINS, 8) f32
    count: Any  # (3 * _BINS,) i64, of primitives; an instance counts for eight
    lower: Any  # (3,) f32: where an axis' first bin begins,
    scale: Any  # (3,) f32: and bins per length; 0 where all centroids are in one plane
    sweep: Any  # (2, 8) f32: the boxes of what is to the right and to the left
    right_area: Any  # (_BINS,) f32, of bin b and all to the right of it
    right_count: Any  # (_BINS,) i64


class _Range(NamedTuple):
    """A node's primitives: order[first : end]."""

    first: int
    end: int
    first_kind: int  # the least and the greatest kind among them
    last_kind: int


class _Plane(NamedTuple):
    """What divides a node: below `bin` along `axis`. axis -1: nothing does."""

    axis: int
    bin: int
    cost: float  # of both sides, in packets' tests times half their areas


@device
def _packets(count):
    """Packets that so many primitives fill, as float32; an instance counts for eight."""
    return np.float32((count + 7) >> 3)


@device
def _kind(primitive, triangles, solids):
    return TRIANGLES if primitive < triangles else (SPHERES if primitive < solids else INSTANCE)


@device
def _clear(boxes, i):
    for k in range(8):
        boxes[i, k] = _NOTHING


@device
def _grow(boxes, i, others, j):
    store(boxes, np.uintp(i * 8), maximum(load(boxes, np.uintp(i * 8)), load(others, np.uintp(j * 8))))


@device
def _swap(box, order, i, j):
    a = load(box, np.uintp(i * 8))
    store(box, np.uintp(i * 8), load(box, np.uintp(j * 8)))
    store(box, np.uintp(j * 8), a)
    order[i], order[j] = order[j], order[i]


@device
def _bin(box, i, axis, lower, scale):
    """The bin of primitive i by its centroid along an axis; centroids are kept doubled."""
    return min(np.int64((box[i, axis + 4] - box[i, axis] - lower) * scale), _BINS - 1)


@device
def _bound(box, order, first, end, triangles, solids, tree_box, node):
    """Grows the node's box around its primitives: (its _Range, least centroid, greatest centroid)."""
    _clear(tree_box, node)
    first_kind = INSTANCE
    last_kind = TRIANGLES
    low0 = low1 = low2 = _INF
    high0 = high1 = high2 = _NOTHING
    for i in range(first, end):
        _grow(tree_box, node, box, i)
        kind = _kind(order[i], triangles, solids)
        first_kind, last_kind = min(first_kind, kind), max(last_kind, kind)
        c0 = box[i, 4] - box[i, 0]
        c1 = box[i, 5] - box[i, 1]
        c2 = box[i, 6] - box[i, 2]
        low0, low1, low2 = min(low0, c0), min(low1, c1), min(low2, c2)
        high0, high1, high2 = max(high0, c0), max(high1, c1), max(high2, c2)
    return _Range(first, end, first_kind, last_kind), (low0, low1, low2), (high0, high1, high2)


@device
def _fill_bins(bins, box, order, node, low, high, solids):
    """Puts a node's primitives into the bins of all three axes."""
    for axis in range(3):
        bins.lower[axis] = low[axis]
        extent = high[axis] - low[axis]
        bins.scale[axis] = _WITHIN / extent if extent > _ZERO else _ZERO
        if not np.isfinite(bins.scale[axis]):  # an extent so small that its reciprocal overflows
            bins.scale[axis] = _ZERO
    for b in range(3 * _BINS):
        _clear(bins.box, b)
        bins.count[b] = 0
    for i in range(node.first, node.end):
        for axis in range(3):
            b = axis * _BINS + _bin(box, i, axis, bins.lower[axis], bins.scale[axis])
            _grow(bins.box, b, box, i)
            bins.count[b] += 1 if order[i] < solids else 8


@device
def _cheapest_plane(bins):
    """The _Plane between two bins for which the surface area heuristic expects the least work."""
    best_axis, best_bin, best_cost = -1, 0, _INF
    for axis in range(3):
        if bins.scale[axis] == _ZERO:
            continue
        _clear(bins.sweep, 0)
        total = 0
        for b in range(_BINS - 1, 0, -1):
            _grow(bins.sweep, 0, bins.box, axis * _BINS + b)
            total += bins.count[axis * _BINS + b]
            bins.right_area[b] = half_area(bins.sweep, 0)
            bins.right_count[b] = total
        _clear(bins.sweep, 1)
        total = 0
        for b in range(1, _BINS):
            _grow(bins.sweep, 1, bins.box, axis * _BINS + b - 1)
            total += bins.count[axis * _BINS + b - 1]
            if total == 0 or bins.right_count[b] == 0:
                continue
            cost = half_area(bins.sweep, 1) * _packets(total) + bins.right_area[b] * _packets(bins.right_count[b])
            if cost < best_cost:
                best_cost, best_axis, best_bin = cost, axis, b
    return _Plane(best_axis, best_bin, best_cost)


@device
def _partition_by_plane(box, order, node, bins, plane):
    """Sorts a node's primitives to both sides of the plane: where the right side begins."""
    lower, scale = bins.lower[plane.axis], bins.scale[plane.axis]
    i, j = node.first, node.end - 1
    while i <= j:
        if _bin(box, i, plane.axis, lower, scale) < plane.bin:
            i += 1
        else:
            _swap(box, order, i, j)
            j -= 1
    return i


@device
def _partition_by_kind(box, order, node, triangles, solids):
    """As `_partition_by_plane`, those of the least kind to the left."""
    i, j = node.first, node.end - 1
    while i <= j:
        if _kind(order[i], triangles, solids) == node.first_kind:
            i += 1
        else:
            _swap(box, order, i, j)
            j -= 1
    return i


@builder
def split(box, order, triangles, solids, tree_box, tree):
    """Splits until every leaf is one packet's worth of one kind, or one instance. Reorders `box` and `order`; fills the tree.

    tree: left child (the right one is the next) or -1, first in `order`, count; tree_box: the nodes' boxes.
    """
    bins = _Bins(
        np.empty((3 * _BINS, 8), np.float32),
        np.empty(3 * _BINS, np.int64),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty((2, 8), np.float32),
        np.empty(_BINS, np.float32),
        np.empty(_BINS, np.int64),
    )
    stack = np.empty((128, 2), np.int32)  # a node, its depth
    tree[0, 1] = 0
    tree[0, 2] = len(order)
    used = 1
    stack[0, 0] = 0
    stack[0, 1] = 0
    top = 1
    while top > 0:
        top -= 1
        number = stack[top, 0]
        depth = stack[top, 1]
        first = np.int64(tree[number, 1])
        count = np.int64(tree[number, 2])
        node, low, high = _bound(box, order, first, first + count, triangles, solids, tree_box, number)
        tree[number, 0] = -1
        if count == 1:
            continue

        plane = _Plane(-1, 0, _INF)
        if depth < _SAH_DEPTH:
            _fill_bins(bins, box, order, node, low, high, solids)
            plane = _cheapest_plane(bins)
        mixed = node.first_kind < node.last_kind
        fits = count <= _LEAF_SIZE and node.last_kind != INSTANCE and not mixed
        if fits and (plane.axis < 0 or half_area(tree_box, number) * (_ONE - _NODE_COST) <= plane.cost):
            continue

        if mixed and count <= _LEAF_SIZE:
            middle = _partition_by_kind(box, order, node, triangles, solids)
        elif plane.axis >= 0:
            middle = _partition_by_plane(box, order, node, bins, plane)
        else:
            middle = node.first + count // 2
        tree[number, 0] = used
        tree[used, 1] = node.first
        tree[used, 2] = middle - node.first
        tree[used + 1, 1] = middle
        tree[used + 1, 2] = node.end - middle
        for side in range(2):  # the left one is on top
            stack[top, 0] = used + 1 - side
            stack[top, 1] = depth + 1
            top += 1
        used += 2
