"""Assembles the world's tree from separately built subtrees: static geometry, moving bodies, and geometry rebuilt for each frame.

A top-level tree is built above the subtrees; if only transforms change, only the top is rebuilt.

The top comes first in the arrays, with spare rows, so that the offsets of the subtrees do not depend on its size. Each subtree
begins at a page boundary, so that files with one subtree each can be mapped consecutively (renderer/scene/compiled_parts.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.build import make_boxes_infinite, tree_of
from renderer.bvh.instances import instance_boxes, relocate, root_boxes
from renderer.bvh.layout import INSTANCE, NODE_ROWS, PACKET_ROWS, PAGE, ROW_CHILD, WIDTH, Bvh
from renderer.bvh.motion_bvh import motion_boxes
from renderer.bvh.transforms import invert_transforms
from renderer.threads import Team

__all__ = ["NODE_BYTES", "PACKET_BYTES", "AssembledBvh", "Tree", "assemble_bvh", "padded"]

Array = npt.NDArray[Any]
Tree = tuple[Array, Array]  # nodes and packets, as returned by `renderer.bvh.build.tree_of`
Room = Callable[
    [str, int, tuple[int, ...], Any, tuple[object, ...]], tuple[Array, bool]
]  # ShotCache.room of renderer/scene/frame_reuse.py


def padded(count: int, row_bytes: int) -> int:
    """Returns the number of array rows, of `row_bytes` each, rounded up so that the rows end at a page boundary."""
    whole = PAGE // math.gcd(PAGE, row_bytes)
    return -(-count // whole) * whole


def _new_array(name: str, length: int, shape: tuple[int, ...], dtype: Any, heads: tuple[object, ...]) -> tuple[Array, bool]:
    return np.zeros((length, *shape), dtype), False


NODE_BYTES, PACKET_BYTES = NODE_ROWS * WIDTH * 4, PACKET_ROWS * WIDTH * 4


class AssembledBvh(NamedTuple):
    """The assembled arrays of all subtrees, and where each subtree starts in them.

    The offsets are those of the top, the static tree, the bodies' trees and the loose tree, followed by the end. "Loose" is
    geometry that is rebuilt for each frame.
    """

    bvh: Bvh
    node: tuple[int, ...]
    packet: tuple[int, ...]
    kept: tuple[object, object]  # the static tree and the bodies' trees, as passed in


def assemble_bvh(
    still: Bvh,
    bodies: Sequence[Tree],
    first_triangle: Sequence[int],
    loose: Tree,
    first_loose: int,
    shown: Array,
    to_world: Array,
    team: Team,
    brute: bool = False,
    room: Room = _new_array,
    keys: Sequence[Array] = (),
    loose_keys: int = 1,
) -> AssembledBvh:
    """Assembles the world's tree and the trees of its instances.

    still: the tree of the static geometry, possibly with instances. bodies: the trees of the moving bodies. loose: a tree of
    world-space geometry that is rebuilt for each frame, without instances. first_triangle: the number of the first triangle of
    each body; first_loose: that of the loose geometry. Their trees number triangles from 0. shown: (J,) the body of each further
    instance. to_world: (I, 3, 4) transforms of all instances, the J of the bodies last. room: returns the arrays to fill,
    possibly those of another frame with their content. For motion while the shutter is open: keys: of each of the J instances,
    (K, KEY_COLUMNS), without rows for a static one; None if all are static. loose_keys: the number of keys of a packet of
    `loose`.
    """
    moving = to_world[len(to_world) - len(shown) :]
    boxes, children = _top_boxes(still, bodies, loose, shown, moving, keys)
    top, _ = tree_of(bounds=boxes, team=team)
    nodes = _page_offsets(
        [padded(max(len(boxes), len(top)), NODE_BYTES), len(still.node), sum(len(node) for node, _ in bodies), len(loose[0])],
        NODE_BYTES,
    )
    packets = _page_offsets([0, len(still.packet), sum(len(packet) for _, packet in bodies), len(loose[1])], PACKET_BYTES)
    # Rows of cached parts are reused if the same part was written to the same rows.
    heads = (still.node, *(array for body in bodies for array in body), *nodes[1:4], *packets[1:4], *first_triangle)
    node, has_nodes = room("node", nodes[-1], (NODE_ROWS, WIDTH), np.float32, heads)
    packet, has_packets = room("packet", packets[-1], (PACKET_ROWS, WIDTH), np.float32, heads)
    if not (has_nodes and has_packets):
        _copy_tree((still.node, still.packet), node, packet, nodes[1], packets[1], 0)
    roots = []
    at, packed = nodes[2], packets[2]
    for body, primitive in zip(bodies, first_triangle, strict=True):
        roots.append(at)
        if not (has_nodes and has_packets):
            _copy_tree(body, node, packet, at, packed, primitive)
        at, packed = at + len(body[0]), packed + len(body[1])
    _copy_tree(loose, node, packet, nodes[3], packets[3], first_loose)
    root = np.concatenate([still.instance_root + np.int32(nodes[1]), np.array(roots, np.int32)[shown]])
    number = np.concatenate([[nodes[1], nodes[3]], ~(4 * (len(still.instance_root) + np.arange(len(shown))) + INSTANCE)])
    _copy_top(top, number[children], node, nodes[1])
    if brute:
        make_boxes_infinite(node)
    bvh = Bvh(node, packet, root.astype(np.int32), invert_transforms(to_world))
    if any(map(len, keys)):
        count = np.array([0] * len(still.instance_root) + [len(each) for each in keys], np.int32)
        begin = np.where(count > 0, np.cumsum(count) - count, 0).astype(np.int32)
        bvh = bvh._replace(motion=np.concatenate(keys), instance_motion=np.stack([begin, count], axis=1))
    if loose_keys > 1:
        bvh = bvh._replace(keyed_packets=np.array([packets[3], loose_keys], np.int32))
    return AssembledBvh(bvh, nodes, packets, (still, bodies))


def _page_offsets(lengths: Sequence[int], row_bytes: int) -> tuple[int, ...]:
    """Returns the offsets of parts with these row counts, each at a page boundary, followed by the end of the last."""
    starts = [0]
    for i, length in enumerate(lengths):
        follows = any(lengths[i + 1 :])
        starts.append(starts[-1] + (padded(length, row_bytes) if follows else length))
    return tuple(starts)


def _copy_tree(tree: Tree, node: Array, packet: Array, first_node: int, first_packet: int, first_primitive: int) -> None:
    nodes, packets = slice(first_node, first_node + len(tree[0])), slice(first_packet, first_packet + len(tree[1]))
    node[nodes], packet[packets] = tree
    relocate(node[nodes], packet[packets], first_node, first_packet, first_primitive)


def _top_boxes(
    still: Bvh, bodies: Sequence[Tree], loose: Tree, shown: Array, moving: Array, keys: Sequence[Array]
) -> tuple[Array, Array]:
    """Returns the boxes over which the top is built, (n, 2, 3), and what each box contains.

    The latter is a number: 0 for the static tree, 1 for the loose tree, 2 + i for instance i of a body.
    """
    placed = instance_boxes(list(bodies), shown, moving)
    for number, each in enumerate(keys):
        if len(each):
            placed[number] = motion_boxes(root_boxes(bodies[shown[number]][0]), each)
    boxes, children = [placed], [2 + np.arange(len(shown))]
    for number, node in ((1, loose[0]), (0, still.node)):
        found = root_boxes(node)
        if len(found):
            boxes.insert(0, np.stack([found[:, 0].min(axis=0), found[:, 1].max(axis=0)])[None])
            children.insert(0, np.array([number]))
    return np.concatenate(boxes), np.concatenate(children)


def _copy_top(top: Array, number: Array, node: Array, room: int) -> None:
    """Writes the top-level tree into its reserved rows of `node`, and clears the rows that it leaves unused.

    number: the child references that replace the top's leaves. room: the number of reserved rows.
    """
    node[: len(top)] = top
    node[len(top) : room] = 0
    child = node[: len(top), ROW_CHILD].view(np.int32)
    leaves = (child < 0) & (top[:, 0] <= top[:, 1])
    child[leaves] = number[~child[leaves] >> 2]
