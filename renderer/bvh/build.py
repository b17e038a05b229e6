"""Builds the BVH: boxes of triangles, spheres and instances, a binary tree over them (split.py), folded into 8-wide nodes.

Folding opens the largest area first, as in Wald, Benthin & Boulos, "Getting rid of packets" (2008).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.fold import count_wide_nodes, fold
from renderer.bvh.instances import Instances, instance_boxes, inverted, relocate
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, ROW_CHILD, WIDTH, Bvh
from renderer.bvh.split import split
from renderer.jit import builder

__all__ = ["build"]


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
    split(box, order, len(triangle), solids, tree_box, tree)
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
