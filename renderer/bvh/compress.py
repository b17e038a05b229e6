"""Converts an 8-wide tree to a compressed one for graphics cards, on all cores.

A wide node becomes a compressed node. So does a packet of two or more primitives; each of its primitives becomes a leaf. A packet
of one primitive, and an instance, become a leaf of the node above. First all reachable nodes are listed and array indices are
assigned to their children; then the nodes are filled in parallel.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.compressed_tree import KEYED, LEAF_NUMBERS, NODE_WORDS, STACK_DEPTH, CompressedTree
from renderer.bvh.layout import CURVES, INSTANCE, LEAF_KIND, MAX_LEVELS, NEVER, ROW_CHILD, ROW_PRIMITIVE, SPHERES, WIDTH, Bvh
from renderer.errors import SceneError
from renderer.jit import device, entry
from renderer.threads import Team, parts_of

__all__ = ["compressed"]

Array = npt.NDArray[Any]

_NOTHING: Any = None  # replaces the arrays of the tree that is compressed
_NODES_PER_JOB = 1 << 12  # nodes
_SLACK = np.float32(4 * 2.0**-24)  # as that of the boxes of wide nodes (renderer/bvh/collapse.py)


class _Source(NamedTuple):
    """The arrays of the 8-wide tree to compress."""

    node: Any
    node_bits: Any  # the same memory, i32
    packet: Any
    packet_bits: Any  # the same memory, i32
    keyed: Any  # the first packet with motion keys
    keys: Any  # their number


class _Plan(NamedTuple):
    """The reachable nodes of the 8-wide tree, and the array indices of the compressed nodes, leaves and keys made from them."""

    order: Any  # (N,) i32, the reachable nodes come first
    first_inner: Any  # (N,) i32, of a wide node's inner children; -1 if it is not reachable
    first_leaf: Any  # (N,) i32, of a wide node's own leaves
    packet_leaf: Any  # (P,) i32, the first leaf of a packet of several primitives
    packet_keys: Any  # (P,) i32, the first row of a packet's keys


class _Target(NamedTuple):
    """The arrays of the compressed tree to fill, and temporary arrays with nodes that are not yet at their final indices."""

    node: Any  # (N, NODE_WORDS) u32
    leaf: Any  # (L, LEAF_NUMBERS) f32
    bits: Any  # the same memory, i32
    content: Any  # (n, NODE_WORDS) u32, of the node at each place in `order`
    below: Any  # (n, 8) i32, the wide node at each of its inner children's places, -1 for a node made from a packet


class _Scratch(NamedTuple):
    """Scratch space for the children of one compressed node; reused for every node."""

    box: Any  # (6, 8) f32: lower x y z, upper x y z
    bits: Any  # the same memory, u32
    slot: Any  # (8,) i64
    members: Any  # (8,) i64
    is_inner: Any  # (8,) bool
    child: Any  # (8,) i64: the wide node, ~ the packet, or ~ of an instance
    step: Any  # (6, 8) u32


def compressed(bvh: Bvh, team: Team) -> Bvh:
    """Returns the Bvh with a compressed tree in place of its nodes and packets. Root nodes are numbered anew.

    bvh: as `build` or `assemble_bvh` returns it; `ray_roots` and `keyed_packets` may be None.
    Raises SceneError if the tree is too deep for the traversal's stack.
    """
    ray_roots = np.zeros(2, np.int32) if bvh.ray_roots is None else bvh.ray_roots
    keyed, keys = (NEVER, 1) if bvh.keyed_packets is None else (int(each) for each in bvh.keyed_packets)
    # The world's root, 0, is the first.
    roots, place = np.unique(np.concatenate([[0], ray_roots, bvh.instance_root]).astype(np.int64), return_inverse=True)
    own = 1 + len(ray_roots)
    ray_places, instance_places = place[1:own].astype(np.int32), place[own:].astype(np.int32)
    source = _Source(bvh.node, bvh.node.view(np.int32), bvh.packet, bvh.packet.view(np.int32), keyed, keys)
    plan = _Plan(
        np.empty(len(bvh.node), np.int32),
        *(np.full(len(bvh.node), -1, np.int32) for _ in range(2)),
        *(np.full(len(bvh.packet), -1, np.int32) for _ in range(2)),
    )
    depth = np.zeros(len(roots), np.int64)
    listed, nodes, leaves = _list_reachable_nodes(source, roots, plan, np.empty((WIDTH * MAX_LEVELS, 2), np.int64), depth)
    levels = int(depth[place[:own]].max(initial=0) + depth[place[own:]].max(initial=0))
    if levels > STACK_DEPTH - 2:
        raise SceneError(f"the scene's tree has {levels} levels; graphics cards can traverse at most {STACK_DEPTH - 2}")
    tree = CompressedTree(_aligned((nodes, NODE_WORDS), np.uint32), _aligned((max(leaves, 1), LEAF_NUMBERS), np.float32))
    target = _Target(
        *tree, tree.leaf.view(np.int32), np.empty((listed, NODE_WORDS), np.uint32), np.empty((listed, WIDTH), np.int32)
    )
    parts = parts_of(0, listed, _NODES_PER_JOB)
    team.each(lambda part: _fill_nodes(source, plan, *part, target, _new_scratch()), parts)
    index = np.empty(len(bvh.node), np.int32)
    index[plan.order[:listed]] = np.arange(listed, dtype=np.int32)
    team.each(lambda part: _copy_inner_children(plan, index, *part, target), parts)
    tree.node[: len(roots)] = target.content[index[roots]]
    kept_roots: Any = None if bvh.ray_roots is None else ray_places
    return bvh._replace(
        node=_NOTHING,
        packet=_NOTHING,
        compressed=tree,
        ray_roots=kept_roots,
        instance_root=instance_places,
    )


def _new_scratch() -> _Scratch:
    integers, flags = (lambda: np.empty(WIDTH, np.int64)), np.empty(WIDTH, np.bool_)
    box = np.empty((6, WIDTH), np.float32)
    return _Scratch(box, box.view(np.uint32), integers(), integers(), flags, integers(), np.empty((6, WIDTH), np.uint32))


def _aligned(shape: tuple[int, int], item: type[np.generic]) -> Array:
    """Returns an uninitialised array whose data are aligned to 16 bytes."""
    size = shape[0] * shape[1] * 4
    memory = np.empty(size + 16, np.uint8)
    start = -memory.ctypes.data % 16
    return memory[start : start + size].view(item).reshape(shape)


@entry
def _list_reachable_nodes(source, roots, plan, stack, depth):
    """Lists the reachable nodes in `plan`; returns the numbers of (reachable nodes, compressed nodes, rows of leaves).

    depth: receives the number of levels of the compressed tree below each root.
    """
    listed, nodes, leaves = 0, len(roots), 0
    for r in range(len(roots)):
        if plan.first_inner[roots[r]] >= 0:
            continue  # a part of another root's tree
        plan.first_inner[roots[r]] = 0
        stack[0, 0], stack[0, 1] = roots[r], 1
        top = 1
        while top > 0:
            top -= 1
            this, level = stack[top, 0], stack[top, 1]
            plan.order[listed] = this
            listed += 1
            inner, own = 0, 0
            depth[r] = max(depth[r], level)
            for lane in range(WIDTH):
                if not source.node[this, 0, lane] <= source.node[this, 1, lane]:
                    continue
                child = source.node_bits[this, ROW_CHILD, lane]
                if child >= 0:
                    inner += 1
                    if plan.first_inner[child] < 0:
                        plan.first_inner[child] = 0
                        stack[top, 0], stack[top, 1] = child, level + 1
                        top += 1
                    continue
                if ~child & LEAF_KIND == INSTANCE:
                    own += 1
                    continue
                number = ~child >> 2
                count = _count_primitives(source.packet, number)
                if count == 1:
                    own += 1
                elif count > 1:
                    inner += 1
                    depth[r] = max(depth[r], level + 1)
                    if plan.packet_leaf[number] < 0:
                        plan.packet_leaf[number] = leaves
                        leaves += count
                if number >= source.keyed and plan.packet_keys[number] < 0:
                    plan.packet_keys[number] = leaves
                    leaves += count * source.keys
            plan.first_inner[this], plan.first_leaf[this] = nodes, leaves
            nodes += inner
            leaves += own
    return listed, nodes, leaves


@entry
def _fill_nodes(source, plan, first, end, target, scratch):
    """Writes the content of reachable nodes first ... end - 1, and the nodes and leaves made from the packets below them."""
    for at in range(first, end):
        this = plan.order[at]
        count = np.int64(0)
        for lane in range(WIDTH):
            if not source.node[this, 0, lane] <= source.node[this, 1, lane]:
                continue
            child = source.node_bits[this, ROW_CHILD, lane]
            scratch.is_inner[count] = child >= 0
            if child < 0 and ~child & LEAF_KIND != INSTANCE:
                primitives = _count_primitives(source.packet, ~child >> 2)
                if primitives == 0:
                    continue
                scratch.is_inner[count] = primitives > 1
            for k in range(3):
                scratch.box[k, count] = source.node[this, 2 * k, lane]
                scratch.box[3 + k, count] = source.node[this, 2 * k + 1, lane]
            scratch.child[count] = child
            count += 1
        _assign_slots(count, scratch)
        first_inner, first_leaf = plan.first_inner[this], plan.first_leaf[this]
        _put_node(target.content, at, count, scratch, first_inner, first_leaf)
        below = 0
        for place in range(WIDTH):  # in the order of slots
            i = scratch.members[place]
            if i < 0:
                continue
            child = scratch.child[i]
            if scratch.is_inner[i]:
                target.below[at, below] = child
                below += 1
            elif ~child & LEAF_KIND == INSTANCE:
                _put_instance(target, first_leaf, ~child >> 2)
                first_leaf += 1
            else:
                _put_primitive(source, plan, target, first_leaf, ~child, np.int64(0))
                first_leaf += 1
        children = below
        for place in range(children):
            child = target.below[at, place]
            if child < 0:
                _put_packet(source, plan, target, first_inner + place, ~child, scratch)
        for place in range(children, WIDTH):
            target.below[at, place] = -1


@entry
def _copy_inner_children(plan, index, first, end, target):
    """Copies the contents of the inner children of reachable nodes first ... end - 1 to their final indices.

    index: each reachable node's position in `plan.order`.
    """
    for at in range(first, end):
        for place in range(WIDTH):
            child = target.below[at, place]
            if child >= 0:
                to = plan.first_inner[plan.order[at]] + place
                for word in range(NODE_WORDS):
                    target.node[to, word] = target.content[index[child], word]


@device
def _count_primitives(packet, number):
    """Returns the number of primitives in a packet."""
    count = 0
    for lane in range(WIDTH):
        if packet[number, 0, lane] == packet[number, 0, lane]:
            count += 1
    return count


@device
def _put_packet(source, plan, target, to, leaf, scratch):
    """Writes the node made from a packet, at index `to`, and the leaves below it. leaf: the packet's number and kind."""
    number, kind = leaf >> 2, leaf & 3
    count = np.int64(0)
    for lane in range(WIDTH):
        if source.packet[number, 0, lane] == source.packet[number, 0, lane]:
            _bound_primitive(source, number, lane, kind, scratch.box, count)
            scratch.child[count] = count
            scratch.is_inner[count] = False
            count += 1
    _assign_slots(count, scratch)
    row = plan.packet_leaf[number]
    _put_node(target.node, np.int64(to), count, scratch, np.int32(0), row)
    for place in range(WIDTH):
        i = scratch.members[place]
        if i >= 0:
            _put_primitive(source, plan, target, row, leaf, i)
            row += 1


@device
def _put_instance(target, row, instance):
    for column in range(LEAF_NUMBERS):
        target.bits[row, column] = 0
    target.bits[row, 3], target.bits[row, 7] = instance, INSTANCE


@device
def _put_primitive(source, plan, target, row, leaf, which):
    """Writes primitive `which` of a packet to row `row` of the leaves. If it has motion keys, also writes its rows of keys."""
    number, kind = leaf >> 2, leaf & 3
    lane, before = 0, which
    while True:
        if source.packet[number, 0, lane] == source.packet[number, 0, lane]:
            if before == 0:
                break
            before -= 1
        lane += 1
    first_key = 0
    if number >= source.keyed:
        first_key = plan.packet_keys[number] + which * source.keys
        kind |= KEYED
        for key in range(source.keys):
            _put_corners(source, target, first_key + key, number + key, lane)
    _put_corners(source, target, row, number, lane)
    primitive = source.packet_bits[number, ROW_PRIMITIVE, lane]
    target.bits[row, 3], target.bits[row, 7], target.bits[row, 11] = primitive, kind, first_key


@device
def _put_corners(source, target, row, number, lane):
    for corner in range(3):
        for k in range(3):
            value = source.packet[number, 3 * corner + k, lane]
            target.leaf[row, 4 * corner + k] = value if value == value else np.float32(0.0)  # NaN where a kind has fewer numbers
        target.bits[row, 4 * corner + 3] = 0


@device
def _bound_primitive(source, number, lane, kind, box, i):
    """Writes a primitive's bounds over all its keys to box i."""
    versions = source.keys if number >= source.keyed else 1
    for k in range(3):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for version in range(number, number + versions):
            if kind == SPHERES:
                centre, radius = source.packet[version, k, lane], abs(source.packet[version, 3, lane])
                low, high = min(low, centre - radius), max(high, centre + radius)
            elif kind == CURVES:
                a, b = source.packet[version, k, lane], source.packet[version, 3 + k, lane]
                first, last = abs(source.packet[version, 6, lane]), abs(source.packet[version, 7, lane])
                low, high = min(low, min(a - first, b - last)), max(high, max(a + first, b + last))
            else:
                a, b = source.packet[version, k, lane], source.packet[version, 3 + k, lane]
                c = source.packet[version, 6 + k, lane]
                low, high = min(low, min(a, min(b, c))), max(high, max(a, max(b, c)))
        box[k, i] = low - abs(low) * _SLACK
        box[3 + k, i] = high + abs(high) * _SLACK


@device
def _sort(members, first, end, box, axis):
    """Sorts members first ... end - 1 by the centre of their boxes along an axis."""
    for i in range(first + 1, end):
        moved, k = members[i], i
        centre = box[axis, moved] + box[3 + axis, moved]
        while k > first and box[axis, members[k - 1]] + box[3 + axis, members[k - 1]] > centre:
            members[k] = members[k - 1]
            k -= 1
        members[k] = moved


@device
def _assign_slots(count, scratch):
    """Assigns slots to `count` boxes, halving them by their centres along x, then y, then z.

    Sets `slot` of each box, and `members` to the box in each slot, -1 for none.
    """
    box, members, slot = scratch.box, scratch.members, scratch.slot
    for i in range(count):
        members[i] = i
    _sort(members, 0, count, box, 0)
    half = (count + 1) // 2
    for x in range(2):
        first, end = (half, count) if x == 1 else (0, half)
        _sort(members, first, end, box, 1)
        middle = first + (end - first + 1) // 2
        for y in range(2):
            low, high = (middle, end) if y == 1 else (first, middle)
            _sort(members, low, high, box, 2)
            for i in range(low, high):
                slot[members[i]] = x + 2 * y + 4 * (i - low)
    for place in range(WIDTH):
        members[place] = -1
    for i in range(count):
        members[slot[i]] = i


@device
def _put_node(node, to, count, scratch, first_inner, first_leaf):
    """Writes a compressed node over `count` children, whose slots are assigned."""
    box, slot, step = scratch.box, scratch.slot, scratch.step
    inner, leaves = 0, 0
    for i in range(count):
        if scratch.is_inner[i]:
            inner |= 1 << slot[i]
        else:
            leaves |= 1 << slot[i]
    exponents = 0
    for k in range(3):
        first, end, start = 0, 0.0, 0.0
        for i in range(count):
            if i == 0 or np.float64(box[k, i]) < start:
                first, start = i, np.float64(box[k, i])
            if i == 0 or np.float64(box[3 + k, i]) > end:
                end = np.float64(box[3 + k, i])
        _, exponent = math.frexp((end - start) / 255.0)
        exponent = min(max(exponent, -126), 127)
        steps = math.ldexp(1.0, -exponent)
        for i in range(WIDTH):
            step[k, i], step[3 + k, i] = 255, 0
        for i in range(count):
            step[k, slot[i]] = np.uint32(max(math.floor((np.float64(box[k, i]) - start) * steps), 0))
            step[3 + k, slot[i]] = np.uint32(min(math.ceil((np.float64(box[3 + k, i]) - start) * steps), 255))
        exponents |= (exponent + 127) << (8 * k)
        node[to, k] = scratch.bits[k, first] if count > 0 else np.uint32(0)
        for half in range(2):
            low, high = 0, 0
            for i in range(4):
                low |= np.int64(step[k, 4 * half + i]) << (8 * i)
                high |= np.int64(step[3 + k, 4 * half + i]) << (8 * i)
            node[to, 8 + 2 * k + half], node[to, 14 + 2 * k + half] = np.uint32(low), np.uint32(high)
    node[to, 3] = np.uint32(exponents | (inner << 24))
    node[to, 4], node[to, 5] = np.uint32(first_inner), np.uint32(first_leaf)
    node[to, 6], node[to, 7] = np.uint32(leaves), np.uint32(0)
