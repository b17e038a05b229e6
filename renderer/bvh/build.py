"""Builds the bounding volume hierarchy (BVH).

Steps: boxes of primitives (boxes.py); a binary tree over them (top.py, split.py), which is collapsed into
8-wide nodes (collapse.py). Collapsing opens the node of largest area first, as in Wald, Benthin & Boulos, "Getting rid of
packets" (2008).
"""

from __future__ import annotations

import contextlib
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import set_number
from renderer.bvh.collapse import Shapes, collapse_all
from renderer.bvh.curve_ends import NO_ENDS, segment_ends
from renderer.bvh.instances import Instances, instance_boxes, relocate
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, ROW_CHILD, ROW_PRIMITIVE, WIDTH, Bvh
from renderer.bvh.top import build_binary_tree, part_size
from renderer.bvh.transforms import invert_transforms
from renderer.jit import entry
from renderer.threads import Team, parts_of

__all__ = ["NO_RADIUS", "build", "make_boxes_infinite", "tree_of", "tree_over"]

Array = npt.NDArray[Any]

NO_RADIUS: Array = np.zeros(0, np.float32)
NO_RADIUS.flags.writeable = False


def build(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    instances: Instances | None = None,
    brute: bool = False,
    team: Team | None = None,
    first_sphere: int | None = None,
    radius: Array = NO_RADIUS,
) -> Bvh:
    """Builds the BVH over T triangles and curve segments, S spheres and I instances.

    position: (V, 3) f32. triangle: (T, 3) i32, rows of `position`. sphere: (S, 4) f32, centre and radius. Any of them may be
    empty. brute: makes every box infinite, so that every ray tests every primitive: slow, for tests and for measuring the BVH's
    benefit. team: the threads that build; None for one per core. first_sphere: the number of the first sphere, T by default.
    radius: (V,) f32, the curves' radius at each vertex: with it, triangles (a, b, b) are segments of curves from a to b.
    Degenerate triangles are stored and never hit. The result does not depend on the number of threads. Runs without the GIL.
    Raises ValueError if a coordinate is not finite or an index is out of range.
    """
    position = np.ascontiguousarray(position, np.float32).reshape(-1, 3)
    triangle = np.ascontiguousarray(triangle, np.int32).reshape(-1, 3)
    sphere = np.ascontiguousarray(sphere, np.float32).reshape(-1, 4)
    radius = np.ascontiguousarray(radius, np.float32)
    if not (np.isfinite(position).all() and np.isfinite(sphere).all() and np.isfinite(radius).all()):
        raise ValueError("a vertex or sphere has a coordinate that is not finite")
    if len(triangle) and not (triangle.min() >= 0 and triangle.max() < len(position)):
        raise ValueError(f"a triangle names a vertex outside 0 ... {len(position) - 1}")
    for array in (position, triangle, sphere, radius):
        array.flags.writeable = False  # one array type for the compiler, whoever calls
    with contextlib.nullcontext(team) if team is not None else Team() as crew:
        first = len(triangle) if first_sphere is None else first_sphere
        return _as_sealed(_build_levels(position, triangle, sphere, first, instances, crew, radius), brute)


def tree_of(
    position: npt.NDArray[Any] = np.zeros((0, 3), np.float32),
    triangle: npt.NDArray[Any] = np.zeros((0, 3), np.int32),
    bounds: npt.NDArray[Any] = np.zeros((0, 2, 3)),
    team: Team | None = None,
    radius: Array = NO_RADIUS,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of one tree, over triangles and curves as for `build`, or instance boxes, (I, 2, 3) f64.

    The arrays have the layout of `build`, but are writable.
    """
    for array in (position, triangle, radius):
        array.flags.writeable = False
    sphere = np.zeros((0, 4), np.float32)
    sphere.flags.writeable = False
    with contextlib.nullcontext(team) if team is not None else Team() as crew:
        return _tree(position, triangle, sphere, len(triangle), bounds, crew, radius)


def tree_over(
    position: npt.NDArray[Any],
    triangle: npt.NDArray[Any],
    sphere: npt.NDArray[Any],
    first_sphere: int,
    team: Team,
    radius: Array = NO_RADIUS,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of a tree over primitives with K motion keys.

    Node boxes bound the primitives at all keys; packets contain the primitives at the first key. position: (K, V, 3) f32. sphere:
    (K, S, 4) f32. radius: (V,) at all keys. Otherwise like `tree_of`.
    """
    nothing = np.zeros((0, 2, 3))
    arrays = [(np.ascontiguousarray(p), np.ascontiguousarray(s)) for p, s in zip(position, sphere, strict=True)]
    triangle, number = _curves_last(triangle, radius)
    for array in (triangle, radius, *(each for pair in arrays for each in pair)):
        array.flags.writeable = False
    if len(triangle) + sphere.shape[1] == 0:
        return _tree(arrays[0][0], triangle, arrays[0][1], first_sphere, nothing, team)
    each = [_shapes(p, triangle, s, first_sphere, radius, number) for p, s in arrays]
    box = np.maximum.reduce([_boxes(shapes, nothing, team) for shapes in each])
    binary = build_binary_tree(box, each[0].first_curve, len(triangle), len(triangle) + sphere.shape[1], team)
    shapes = each[0]
    return _renumbered(collapse_all(binary, shapes, team), number)


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
    radius: Array,
) -> Bvh:
    """Builds the two-level BVH: the world's tree and, with instances, one tree for each instanced geometry."""
    nothing = np.zeros((0, 2, 3))
    if instances is None:
        node, packet = _tree(position, triangle, sphere, first_sphere, nothing, team, radius)
        return Bvh(node, packet, np.zeros(0, np.int32), np.zeros((0, 3, 4)))

    first = [int(f) for f in instances.first]
    trees = [_tree(position, triangle[a:b], sphere[:0], 0, nothing, team, radius) for a, b in pairwise(first)]
    to_world = np.asarray(instances.to_world, np.float64).reshape(-1, 3, 4)
    bounds = instance_boxes(trees, instances.tree, to_world)
    node, packet = _tree(position, triangle[: first[0]], sphere, first_sphere, bounds, team, radius)
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
    radius: Array = NO_RADIUS,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Returns the nodes and packets of a single tree over triangles, curve segments, spheres and instance boxes.

    bounds: (I, 2, 3) f64, the boxes of the instances that this tree contains.
    """
    solids = len(triangle) + len(sphere)
    count = solids + len(bounds)
    if count == 0:
        node = np.full((1, NODE_ROWS, WIDTH), np.inf, np.float32)
        node[:, 1:6:2] = -np.inf
        node[:, ROW_CHILD] = 0
        return node, np.empty((0, PACKET_ROWS, WIDTH), np.float32)
    triangle, number = _curves_last(triangle, radius)
    shapes = _shapes(position, triangle, sphere, first_sphere, radius, number)
    binary = build_binary_tree(_boxes(shapes, bounds, team), shapes.first_curve, len(triangle), solids, team)
    return _renumbered(collapse_all(binary, shapes, team), number)


class _CurveNumbers(NamedTuple):
    """The primitive numbers of triangles that are sorted by kind, (T,), and how many of them are curve segments."""

    number: Array
    curves: int


def _shapes(
    position: Array, triangle: Array, sphere: Array, first_sphere: int, radius: Array, number: _CurveNumbers | None
) -> Shapes:
    """Returns the shapes of a tree, with the ends of curve segments. triangle, number: from `_curves_last`."""
    if number is None:
        return Shapes(position, triangle, sphere, first_sphere, len(triangle), radius, NO_ENDS)
    first = len(triangle) - number.curves
    ends = segment_ends(position, triangle[first:, :2], radius)
    ends.flags.writeable = False
    return Shapes(position, triangle, sphere, first_sphere, first, radius, ends)


def _curves_last(triangle: Array, radius: Array) -> tuple[Array, _CurveNumbers | None]:
    """Returns the triangles with curve segments after the others, and their numbers before; (the same, None) without curves."""
    if not len(radius):
        return triangle, None
    is_curve = (triangle[:, 1] == triangle[:, 2]) & (triangle[:, 0] != triangle[:, 1])
    number = np.argsort(is_curve, kind="stable").astype(np.int32)
    triangle = np.ascontiguousarray(triangle[number])
    triangle.flags.writeable = False
    return triangle, _CurveNumbers(number, int(np.count_nonzero(is_curve)))


def _renumbered(tree: tuple[Array, Array], number: _CurveNumbers | None) -> tuple[Array, Array]:
    """Gives the primitives in a tree's packets their numbers before `_curves_last`; returns the tree."""
    if number is not None:
        stored = tree[1][:, ROW_PRIMITIVE].view(np.int32)
        changes = ~np.isnan(tree[1][:, 0]) & (stored < len(number.number))  # not for spheres
        stored[changes] = number.number[stored[changes]]
    return tree


def _boxes(shapes: Shapes, bounds: npt.NDArray[Any], team: Team) -> npt.NDArray[np.float32]:
    """Returns the boxes of all primitives, in the layout of boxes.py."""
    solids = len(shapes.triangle) + len(shapes.sphere)
    box = np.empty((solids + len(bounds), 8), np.float32)
    box[solids:, :3], box[solids:, 4:7] = -bounds[:, 0], bounds[:, 1]
    parts = parts_of(0, len(box), part_size(len(box)))
    team.each(lambda part: _primitive_boxes(shapes, *part, box), parts)
    return box


def _as_sealed(bvh: Bvh, brute: bool) -> Bvh:
    if brute:
        make_boxes_infinite(bvh.node)
    for array in (bvh.node, bvh.packet, bvh.instance_root, bvh.to_local):
        array.flags.writeable = False
    return bvh


@entry
def _primitive_boxes(shapes, first, end, box):
    """Writes the boxes of primitives first ... end - 1 into `box`.

    Boxes of instances must be filled in already; only their primitive numbers are written.
    """
    position, triangle, sphere = shapes.position, shapes.triangle, shapes.sphere
    for i in range(first, min(end, shapes.first_curve)):
        a, b, c = triangle[i, 0], triangle[i, 1], triangle[i, 2]
        for k in range(3):
            box[i, k] = -min(position[a, k], position[b, k], position[c, k])
            box[i, 4 + k] = max(position[a, k], position[b, k], position[c, k])
    for i in range(max(first, shapes.first_curve), min(end, len(triangle))):
        a, b = triangle[i, 0], triangle[i, 1]
        for k in range(3):
            box[i, k] = max(shapes.radius[a] - position[a, k], shapes.radius[b] - position[b, k])
            box[i, 4 + k] = max(shapes.radius[a] + position[a, k], shapes.radius[b] + position[b, k])
    for i in range(max(first, len(triangle)), min(end, len(triangle) + len(sphere))):
        s = i - len(triangle)
        radius = abs(sphere[s, 3])
        for k in range(3):
            box[i, k] = radius - sphere[s, k]
            box[i, 4 + k] = radius + sphere[s, k]
    for i in range(first, end):
        set_number(box, i, i)
