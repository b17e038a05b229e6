"""Builds the bounding volume hierarchy (BVH).

Steps: boxes of triangles, spheres and instances (boxes.py); a binary tree over them (top.py, split.py), which is collapsed into
8-wide nodes (collapse.py). Collapsing opens the node of largest area first, as in Wald, Benthin & Boulos, "Getting rid of
packets" (2008).
"""

from __future__ import annotations

import contextlib
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import set_number
from renderer.bvh.collapse import Shapes, collapse_all
from renderer.bvh.instances import Instances, instance_boxes, relocate
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, ROW_CHILD, WIDTH, Bvh
from renderer.bvh.top import build_binary_tree, part_size
from renderer.bvh.transforms import invert_transforms
from renderer.jit import entry
from renderer.threads import Team, parts_of

__all__ = ["build", "make_boxes_infinite", "tree_of", "tree_over"]


def build(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    instances: Instances | None = None,
    brute: bool = False,
    team: Team | None = None,
    first_sphere: int | None = None,
) -> Bvh:
    """Builds the BVH over T triangles, S spheres and I instances.

    position: (V, 3) f32. triangle: (T, 3) i32, rows of `position`. sphere: (S, 4) f32, centre and radius. Any of them may be
    empty. brute: makes every box infinite, so that every ray tests every primitive: slow, for tests and for measuring the BVH's
    benefit. team: the threads that build; None for one per core. first_sphere: the number of the first sphere, T by default.
    Degenerate triangles are stored and never hit. The result does not depend on the number of threads. Runs without the GIL.
    Raises ValueError if a coordinate is not finite or an index is out of range.
    """
    position = np.ascontiguousarray(position, np.float32).reshape(-1, 3)
    triangle = np.ascontiguousarray(triangle, np.int32).reshape(-1, 3)
    sphere = np.ascontiguousarray(sphere, np.float32).reshape(-1, 4)
    if not (np.isfinite(position).all() and np.isfinite(sphere).all()):
        raise ValueError("a vertex or sphere has a coordinate that is not finite")
    if len(triangle) and not (triangle.min() >= 0 and triangle.max() < len(position)):
        raise ValueError(f"a triangle names a vertex outside 0 ... {len(position) - 1}")
    for array in (position, triangle, sphere):
        array.flags.writeable = False  # one array type for the compiler, whoever calls
    with contextlib.nullcontext(team) if team is not None else Team() as crew:
        first = len(triangle) if first_sphere is None else first_sphere
        return _as_sealed(_build_levels(position, triangle, sphere, first, instances, crew), brute)


def tree_of(
    position: npt.NDArray[Any] = np.zeros((0, 3), np.float32),
    triangle: npt.NDArray[Any] = np.zeros((0, 3), np.int32),
    bounds: npt.NDArray[Any] = np.zeros((0, 2, 3)),
    team: Team | None = None,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of one tree, over triangles as for `build`, or over instance boxes, (I, 2, 3) f64.

    The arrays have the layout of `build`, but are writable.
    """
    for array in (position, triangle):
        array.flags.writeable = False
    sphere = np.zeros((0, 4), np.float32)
    sphere.flags.writeable = False
    with contextlib.nullcontext(team) if team is not None else Team() as crew:
        return _tree(position, triangle, sphere, len(triangle), bounds, crew)


def tree_over(
    position: npt.NDArray[Any], triangle: npt.NDArray[Any], sphere: npt.NDArray[Any], first_sphere: int, team: Team
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of a tree over primitives with K motion keys.

    Node boxes bound the primitives at all keys; packets contain the primitives at the first key. position: (K, V, 3) f32. sphere:
    (K, S, 4) f32. Otherwise like `tree_of`.
    """
    nothing = np.zeros((0, 2, 3))
    arrays = [(np.ascontiguousarray(p), np.ascontiguousarray(s)) for p, s in zip(position, sphere, strict=True)]
    for array in (triangle, *(each for pair in arrays for each in pair)):
        array.flags.writeable = False
    if len(triangle) + sphere.shape[1] == 0:
        return _tree(arrays[0][0], triangle, arrays[0][1], first_sphere, nothing, team)
    box = _boxes(arrays[0][0], triangle, arrays[0][1], nothing, team)
    for p, s in arrays[1:]:
        np.maximum(box, _boxes(p, triangle, s, nothing, team), out=box)
    binary = build_binary_tree(box, len(triangle), len(triangle) + sphere.shape[1], team)
    return collapse_all(binary, Shapes(arrays[0][0], triangle, arrays[0][1], first_sphere), team)


def make_boxes_infinite(node: npt.NDArray[Any]) -> None:
    """Makes every child box of the nodes infinite, so that every ray intersects it. Empty boxes of unused lanes stay empty."""
    used = node[:, 0] <= node[:, 1]
    for row in range(6):
        node[:, row][used] = np.inf if row & 1 else -np.inf


def _build_levels(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    first_sphere: int,
    instances: Instances | None,
    team: Team,
) -> Bvh:
    """Builds the two-level BVH: the world's tree and, with instances, one tree for each instanced geometry."""
    nothing = np.zeros((0, 2, 3))
    if instances is None:
        node, packet = _tree(position, triangle, sphere, first_sphere, nothing, team)
        return Bvh(node, packet, np.zeros(0, np.int32), np.zeros((0, 3, 4)))

    first = [int(f) for f in instances.first]
    trees = [_tree(position, triangle[a:b], sphere[:0], 0, nothing, team) for a, b in pairwise(first)]
    to_world = np.asarray(instances.to_world, np.float64).reshape(-1, 3, 4)
    bounds = instance_boxes(trees, instances.tree, to_world)
    node, packet = _tree(position, triangle[: first[0]], sphere, first_sphere, bounds, team)
    nodes, packets, roots = [node], [packet], []
    for (node, packet), primitive in zip(trees, first, strict=False):
        roots.append(sum(map(len, nodes)))
        relocate(node, packet, roots[-1], sum(map(len, packets)), primitive)
        nodes.append(node)
        packets.append(packet)
    root = np.array(roots, np.int32)[instances.tree]
    return Bvh(np.concatenate(nodes), np.concatenate(packets), root, invert_transforms(to_world))


def _tree(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    first_sphere: int,
    bounds: npt.NDArray[Any],
    team: Team,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of a single tree over triangles, spheres and instance boxes.

    bounds: (I, 2, 3) f64, the boxes of the instances that this tree contains.
    """
    solids = len(triangle) + len(sphere)
    count = solids + len(bounds)
    if count == 0:
        node = np.full((1, NODE_ROWS, WIDTH), np.inf, np.float32)
        node[:, 1:6:2] = -np.inf
        node[:, ROW_CHILD] = 0
        return node, np.empty((0, PACKET_ROWS, WIDTH), np.float32)
    binary = build_binary_tree(_boxes(position, triangle, sphere, bounds, team), len(triangle), solids, team)
    return collapse_all(binary, Shapes(position, triangle, sphere, first_sphere), team)


def _boxes(
    position: npt.NDArray[Any], triangle: npt.NDArray[Any], sphere: npt.NDArray[Any], bounds: npt.NDArray[Any], team: Team
) -> npt.NDArray[np.float32]:
    """Returns the boxes of all primitives, in the layout of boxes.py."""
    solids = len(triangle) + len(sphere)
    box = np.empty((solids + len(bounds), 8), np.float32)
    box[solids:, :3], box[solids:, 4:7] = -bounds[:, 0], bounds[:, 1]
    parts = parts_of(0, len(box), part_size(len(box)))
    team.each(lambda part: _primitive_boxes(position, triangle, sphere, *part, box), parts)
    return box


def _as_sealed(bvh: Bvh, brute: bool) -> Bvh:
    if brute:
        make_boxes_infinite(bvh.node)
    for array in (bvh.node, bvh.packet, bvh.instance_root, bvh.to_local):
        array.flags.writeable = False
    return bvh


@entry
def _primitive_boxes(position, triangle, sphere, first, end, box):
    """Writes the boxes of primitives first ... end - 1 into `box`.

    Boxes of instances must be filled in already; only their primitive numbers are written.
    """
    for i in range(first, min(end, len(triangle))):
        a, b, c = triangle[i, 0], triangle[i, 1], triangle[i, 2]
        for k in range(3):
            box[i, k] = -min(position[a, k], position[b, k], position[c, k])
            box[i, 4 + k] = max(position[a, k], position[b, k], position[c, k])
    for i in range(max(first, len(triangle)), min(end, len(triangle) + len(sphere))):
        s = i - len(triangle)
        radius = abs(sphere[s, 3])
        for k in range(3):
            box[i, k] = radius - sphere[s, k]
            box[i, 4 + k] = radius + sphere[s, k]
    for i in range(first, end):
        set_number(box, i, i)
