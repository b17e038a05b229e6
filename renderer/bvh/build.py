"""Builds the BVH: a binned surface-area-heuristic binary tree over triangles and spheres, folded into 8-wide nodes.

Binning after Wald, "On fast construction of SAH-based bounding volume hierarchies" (2007); folding by the largest area
first, as in Wald, Benthin & Boulos, "Getting rid of packets" (2008). Boxes are kept as (-lower, upper), so that one
8-lane maximum grows one by another.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.fold import count_wide_nodes, fold, half_area
from renderer.bvh.instances import Instances, instance_boxes, inverted, relocate
from renderer.bvh.layout import INSTANCE, NODE_ROWS, PACKET_ROWS, ROW_CHILD, SPHERES, TRIANGLES, WIDTH, Bvh
from renderer.bvh.simd import load, maximum, store
from renderer.jit import builder, device

__all__ = ["build"]

_BINS = 16
_SAH_DEPTH = 40  # below, ranges are halved: see STACK_SIZE in layout.py
_NODE_COST = np.float32(0.2)  # of one binary level, in units of one packet's test; measured on meshes and on Cornell boxes


_ONE = np.float32(1.0)
_NOTHING = np.float32(-np.inf)


def build(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    instances: Instances | None = None,
    brute: bool = False,
) -> Bvh:
    """The tree over T triangles, S spheres and I instances.

    position: (V, 3) f32; triangle: (T, 3) i32 into it; sphere: (S, 4) f32, centre and radius. Any of them may be empty.
    brute: every box is boundless, so that every ray meets every primitive: slow, to see and to test what a tree is good for.
    Degenerate triangles are kept and never hit. The same input gives the same bytes. Runs without the GIL.
    Raises ValueError where a coordinate is not finite or an index is out of range.
    """
    position = np.ascontiguousarray(position, np.float32).reshape(-1, 3)
    triangle = np.ascontiguousarray(triangle, np.int32).reshape(-1, 3)
    sphere = np.ascontiguousarray(sphere, np.float32).reshape(-1, 4)
    if not (np.isfinite(position).all() and np.isfinite(sphere).all()):
        raise ValueError("a vertex or sphere has a coordinate that is not finite")
    if len(triangle) and not (triangle.min() >= 0 and triangle.max() < len(position)):
        raise ValueError(f"a triangle names a vertex outside 0 ... {len(position) - 1}")
    for array in (position, triangle, sphere):
        array.flags.writeable = False  # one type for the compiler, whoever calls
    if instances is None:
        node, packet = _tree(position, triangle, sphere, len(triangle), np.zeros((0, 2, 3)))
        return _sealed(Bvh(node, packet, np.zeros(0, np.int32), np.zeros((0, 3, 4))), brute)

    first = [int(f) for f in instances.first]
    trees = [_tree(position, triangle[a:b], sphere[:0], 0, np.zeros((0, 2, 3))) for a, b in pairwise(first)]
    to_world = np.asarray(instances.to_world, np.float64).reshape(-1, 3, 4)
    node, packet = _tree(position, triangle[: first[0]], sphere, len(triangle), instance_boxes(trees, instances.tree, to_world))
    nodes, packets, roots = [node], [packet], []
    for (node, packet), primitive in zip(trees, first, strict=False):
        roots.append(sum(map(len, nodes)))
        relocate(node, packet, roots[-1], sum(map(len, packets)), primitive)
        nodes.append(node)
        packets.append(packet)
    root = np.array(roots, np.int32)[instances.tree]
    return _sealed(Bvh(np.concatenate(nodes), np.concatenate(packets), root, inverted(to_world)), brute)


def _tree(
    position: npt.NDArray[Any], triangle: npt.NDArray[Any], sphere: npt.NDArray[Any], first_sphere: int, bounds: npt.NDArray[Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """One level's nodes and packets; bounds: (I, 2, 3) f64, of the instances in it."""
    solids = len(triangle) + len(sphere)
    count = solids + len(bounds)
    if count == 0:
        node = np.full((1, NODE_ROWS, WIDTH), np.inf, np.float32)
        node[:, 1:6:2] = -np.inf
        node[:, ROW_CHILD] = 0
        return node, np.empty((0, PACKET_ROWS, WIDTH), np.float32)
    box = np.zeros((count, 8), np.float32)
    order = np.arange(count, dtype=np.int32)
    tree_box = np.empty((2 * count, 8), np.float32)
    tree = np.empty((2 * count, 3), np.int32)  # left child (right is the next) or -1; first in `order`; count
    _primitive_boxes(position, triangle, sphere, box)
    box[solids:, :3], box[solids:, 4:7] = -bounds[:, 0], bounds[:, 1]
    _split(box, order, len(triangle), solids, tree_box, tree)
    nodes, packets = count_wide_nodes(tree_box, tree, order, solids)
    node = np.empty((nodes, NODE_ROWS, WIDTH), np.float32)
    packet = np.empty((packets, PACKET_ROWS, WIDTH), np.float32)
    fold(tree_box, tree, order, position, triangle, sphere, first_sphere, node, packet)
    return node, packet


def _sealed(bvh: Bvh, brute: bool) -> Bvh:
    if brute:
        used = bvh.node[:, 0] <= bvh.node[:, 1]
        for row in range(6):
            bvh.node[:, row][used] = np.inf if row & 1 else -np.inf
    for array in bvh:
        array.flags.writeable = False
    return bvh


@builder
def _primitive_boxes(position, triangle, sphere, box):
    """Each primitive's box as (-lower, 0, upper, 0)."""
    triangles = len(triangle)
    for i in range(triangles):
        a, b, c = triangle[i, 0], triangle[i, 1], triangle[i, 2]
        for k in range(3):
            box[i, k] = -min(position[a, k], position[b, k], position[c, k])
            box[i, 4 + k] = max(position[a, k], position[b, k], position[c, k])
        box[i, 3] = box[i, 7] = np.float32(0.0)
    for s in range(len(sphere)):
        i = triangles + s
        radius = abs(sphere[s, 3])
        for k in range(3):
            box[i, k] = radius - sphere[s, k]
            box[i, 4 + k] = radius + sphere[s, k]
        box[i, 3] = box[i, 7] = np.float32(0.0)


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


@builder
def _split(box, order, triangles, solids, tree_box, tree):
    """Splits until every leaf is one packet's worth of one kind, or one instance. Reorders `box` and `order`; fills the tree."""
    bin_box = np.empty((3 * _BINS, 8), np.float32)
    bin_count = np.empty(3 * _BINS, np.int64)
    right_area = np.empty(_BINS, np.float32)
    right_count = np.empty(_BINS, np.int64)
    sweep = np.empty((2, 8), np.float32)
    lower = np.empty(3, np.float32)
    scale = np.empty(3, np.float32)
    pending = np.empty((128, 2), np.int32)

    tree[0, 1] = 0
    tree[0, 2] = len(order)
    used = 1
    pending[0, 0] = 0
    pending[0, 1] = 0
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node = pending[waiting, 0]
        depth = pending[waiting, 1]
        first = np.int64(tree[node, 1])
        count = np.int64(tree[node, 2])
        end = first + count

        _clear(tree_box, node)
        first_kind = INSTANCE
        last_kind = TRIANGLES
        low0 = low1 = low2 = np.float32(np.inf)
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
        mixed = first_kind < last_kind
        fits = count <= 8 and last_kind != INSTANCE and not mixed
        tree[node, 0] = -1
        if count == 1:
            continue

        best_axis = -1
        best_bin = 0
        best_cost = np.float32(np.inf)
        if depth < _SAH_DEPTH:
            lower[0], lower[1], lower[2] = low0, low1, low2
            for axis in range(3):
                extent = (high0, high1, high2)[axis] - lower[axis]
                scale[axis] = np.float32(_BINS * (1.0 - 1e-6)) / extent if extent > np.float32(0.0) else np.float32(0.0)
                if not np.isfinite(scale[axis]):  # an extent so small that its reciprocal overflows
                    scale[axis] = np.float32(0.0)
            for b in range(3 * _BINS):
                _clear(bin_box, b)
                bin_count[b] = 0
            for i in range(first, end):
                for axis in range(3):
                    b = axis * _BINS + _bin(box, i, axis, lower[axis], scale[axis])
                    _grow(bin_box, b, box, i)
                    bin_count[b] += 1 if order[i] < solids else 8
            for axis in range(3):
                if scale[axis] == np.float32(0.0):
                    continue
                _clear(sweep, 0)
                total = 0
                for b in range(_BINS - 1, 0, -1):
                    _grow(sweep, 0, bin_box, axis * _BINS + b)
                    total += bin_count[axis * _BINS + b]
                    right_area[b] = half_area(sweep, 0)
                    right_count[b] = total
                _clear(sweep, 1)
                total = 0
                for b in range(1, _BINS):
                    _grow(sweep, 1, bin_box, axis * _BINS + b - 1)
                    total += bin_count[axis * _BINS + b - 1]
                    if total == 0 or right_count[b] == 0:
                        continue
                    cost = half_area(sweep, 1) * _packets(total) + right_area[b] * _packets(right_count[b])
                    if cost < best_cost:
                        best_cost, best_axis, best_bin = cost, axis, b
        area = half_area(tree_box, node)
        if fits and (best_axis < 0 or area * (_ONE - _NODE_COST) <= best_cost):
            continue

        i = first
        j = end - 1
        if best_axis >= 0 and not (mixed and count <= 8):
            while i <= j:
                if _bin(box, i, best_axis, lower[best_axis], scale[best_axis]) < best_bin:
                    i += 1
                else:
                    _swap(box, order, i, j)
                    j -= 1
        elif mixed and count <= 8:
            while i <= j:
                if _kind(order[i], triangles, solids) == first_kind:
                    i += 1
                else:
                    _swap(box, order, i, j)
                    j -= 1
        else:
            i = first + count // 2
        tree[node, 0] = used
        tree[used, 1] = first
        tree[used, 2] = i - first
        tree[used + 1, 1] = i
        tree[used + 1, 2] = end - i
        for side in range(2):
            pending[waiting, 0] = used + 1 - side
            pending[waiting, 1] = depth + 1
            waiting += 1
        used += 2
