"""Adds root nodes for kinds of rays to which some primitives or instances are invisible.

Nodes above such primitives are copied without them; all other nodes are shared. The traversal is unchanged: these rays merely
start at another root node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import INSTANCE, LEAF_KIND, NEVER, ROW_CHILD, ROW_PRIMITIVE, Bvh
from renderer.bvh.subtrees import NODE_BYTES, PACKET_BYTES, AssembledBvh, padded

__all__ = ["exclude_primitives"]

Array = npt.NDArray[Any]
_FEWEST = 2  # roots: of camera rays and of shadow rays


def exclude_primitives(
    laid: AssembledBvh,
    *left_out: npt.NDArray[np.bool_],
    instances: Sequence[npt.NDArray[np.bool_]] = (),
    copies_root: Sequence[int] = (),
) -> AssembledBvh:
    """Returns the tree with a separate root node for each kind of ray, from which the excluded primitives are missing.

    left_out: (primitives,) bool for each kind in the order of `Bvh.ray_roots`, at least two: invisible to such rays. All such
    primitives must be in the world's own tree, not in an instance's. instances: (I,) bool, the instances that are invisible to
    the last kinds. copies_root: kinds that get a copy of a root node even if all primitives are visible to them.
    """
    if not (any(mask.any() for mask in (*left_out, *instances)) or len(left_out) > _FEWEST):
        return laid
    bvh = laid.bvh
    # New rows follow the loose part, from a page boundary on (renderer/scene/compiled_parts.py).
    first_node, first_packet = padded(len(bvh.node), NODE_BYTES), padded(len(bvh.packet), PACKET_BYTES)
    nodes, packets = _Rows(first_node), _Rows(first_packet)
    roots = np.zeros(len(left_out), np.int32)
    none = np.zeros(len(bvh.instance_root), np.bool_)
    of_instances = [none] * (len(left_out) - len(instances)) + [*instances]
    known: dict[tuple[bytes, bytes], int] = {}
    for kind, (mask, of_instance) in enumerate(zip(left_out, of_instances, strict=True)):
        key = mask.tobytes(), of_instance.tobytes()
        if (mask.any() or of_instance.any()) and key not in known:
            known[key] = _copy_without(bvh, mask, of_instance, nodes, packets)
        roots[kind] = known.get(key, 0)
        if kind in copies_root and roots[kind] == 0:
            roots[kind] = nodes.put(bvh.node[0].copy())
    node, packet = _with_rows(bvh.node, nodes), _with_rows(bvh.packet, packets)
    grown = bvh._replace(node=node, packet=packet, ray_roots=roots)
    return laid._replace(
        bvh=grown, node=_section_starts(laid.node, first_node, node), packet=_section_starts(laid.packet, first_packet, packet)
    )


class _Rows:
    """Rows that will be appended to an array. `first`: the index of the first one, which is the array's present length."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.rows: list[Array] = []

    def put(self, *rows: Array) -> int:
        """Collects rows to append to the array; returns the index that the first of these rows will have."""
        self.rows += rows
        return self.first + len(self.rows) - len(rows)


def _with_rows(array: Array, more: _Rows) -> Array:
    grown = np.zeros((more.first + len(more.rows), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    if more.rows:
        grown[more.first :] = more.rows
    return grown


def _section_starts(places: tuple[int, ...], first: int, array: Array) -> tuple[int, ...]:
    """Returns the start indices of an array's sections after rows were appended to the last section.

    Empty sections at the end are moved to the new end.
    """
    end = places[-1]
    return (*(first if place == end and number else place for number, place in enumerate(places[:-1])), len(array))


def _copy_without(
    bvh: Bvh, left_out: npt.NDArray[np.bool_], instances: npt.NDArray[np.bool_], nodes: _Rows, packets: _Rows
) -> int:
    """Appends changed copies of a tree's nodes and packets, with some primitives omitted; returns the new root node.

    left_out: (primitives,) bool, the primitives to omit; instances: (I,) bool, likewise. Nodes and packets that do not change are
    shared.
    """
    child = bvh.node[:, ROW_CHILD].view(np.int32)
    there = bvh.node[:, 0] <= bvh.node[:, 1]
    number = bvh.packet[:, ROW_PRIMITIVE].view(np.int32)
    is_out = ~np.isnan(bvh.packet[:, 0])
    is_out[is_out] = left_out[number[is_out]]
    changes = np.any(is_out, axis=1)
    is_leaf = there & (child < 0) & (~child & LEAF_KIND != INSTANCE)
    is_hidden = there & (child < 0) & ~is_leaf
    is_hidden[is_hidden] = instances[~child[is_hidden] >> 2]
    has_changed = (is_hidden | is_leaf & changes[np.where(is_leaf, ~child >> 2, 0)]).any(axis=1)
    above = _parents(child, there)
    on_the_way = set()
    for node in np.flatnonzero(has_changed & (above >= 0)):
        while node not in on_the_way:
            on_the_way.add(int(node))
            node = above[node]

    def leaf_without(leaf: int) -> int | None:
        first = leaf >> 2
        if (is_out[first] | np.isnan(bvh.packet[first, 0])).all():
            return None
        count = int(bvh.keyed_packets[1]) if bvh.keyed_packets[0] != NEVER else 1
        start = packets.put(
            *(_clear_lanes(bvh.packet[first + (k if first >= bvh.keyed_packets[0] else 0)], is_out[first]) for k in range(count))
        )
        return ~(4 * start + (leaf & 3))

    def node_without(number: int) -> int | None:
        row = bvh.node[number].copy()
        for lane in np.flatnonzero(there[number]):
            this = int(child[number, lane])
            if this in on_the_way:
                instead = node_without(this)
            elif is_leaf[number, lane] and changes[~this >> 2]:
                instead = leaf_without(~this)
            elif is_hidden[number, lane]:
                instead = None
            else:
                continue
            if instead is None:
                row[0:6:2, lane], row[1:6:2, lane] = np.inf, -np.inf
            row[ROW_CHILD].view(np.int32)[lane] = instead or 0
        return nodes.put(row) if number == 0 or (row[0] <= row[1]).any() else None

    return (node_without(0) or 0) if on_the_way else 0


def _clear_lanes(packet: Array, is_out: npt.NDArray[np.bool_]) -> Array:
    packet = packet.copy()
    packet[:, is_out] = np.nan
    return packet


def _parents(child: npt.NDArray[np.int32], there: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Returns the parent of each node of the world's tree, (N,); -1 for all other nodes. The root is its own parent.

    child: (N, lanes), the child references. there: (N, lanes), True for lanes with a child.
    """
    above = np.full(len(child), -1, np.int64)
    above[0] = 0
    level = np.zeros(1, np.int64)
    while len(level):
        lanes = there[level] & (child[level] >= 0)
        below = child[level][lanes]
        above[below] = np.repeat(level, lanes.sum(axis=1))
        level = below.astype(np.int64)
    return above
