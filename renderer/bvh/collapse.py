"""Collapses the binary tree into 8-wide nodes and its leaves into packets."""

from __future__ import annotations

from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import half_area
from renderer.bvh.layout import (
    CURVES,
    INSTANCE,
    MAX_LEVELS,
    NODE_ROWS,
    NODE_SIZE,
    PACKET_ROWS,
    PACKET_SIZE,
    ROW_CHILD,
    ROW_PRIMITIVE,
    SPHERES,
    STACK_SIZE,
    TRIANGLES,
    WIDTH,
)
from renderer.bvh.simd import load, splat, store, store_int
from renderer.bvh.top import MOST_PARTS, BinaryTree, part_size
from renderer.jit import device, entry
from renderer.threads import Team

__all__ = ["Shapes", "collapse_all"]

# Two units in the last place on each side: with the traversal's slack for the origin, rounding never loses a hit.
_SLACK = np.float32(4 * 2.0**-24)
_MOST_ASIDE = MOST_PARTS * MAX_LEVELS * WIDTH  # children of nodes that are larger than a part
_EIGHT = np.uintp(8)

Array = npt.NDArray[Any]


class Shapes(NamedTuple):
    """The triangles, curve segments and spheres whose coordinates are copied into packets."""

    position: Array  # (V, 3) f32
    triangle: Array  # (T, 3) i32, those that are curve segments last
    sphere: Array  # (S, 4) f32
    first_sphere: int  # the first sphere's primitive number
    first_curve: int  # the first curve segment among the triangles
    radius: Array  # (V,) f32 of curves at their vertices, or no rows
    ends: Array  # (c, 3) f32: the last three numbers of each curve segment (`segment_ends` of curve_ends.py), or no rows


def collapse_all(binary: BinaryTree, shapes: Shapes, team: Team) -> tuple[Array, Array]:
    """Collapses a binary tree; returns the wide nodes and the packets.

    The nodes over more primitives than `part_size` come first in the arrays; the subtrees below them follow, and are filled by
    all threads in parallel.
    """
    solids = len(shapes.triangle) + len(shapes.sphere)
    part = part_size(len(binary.order))
    least = part if len(binary.order) > part else 0
    aside = np.empty((_MOST_ASIDE if least else 0, 2), np.int32)
    nodes, packets, count = _count(binary, solids, 0, least, aside, *_scratch())
    roots = aside[:count].tolist()
    sizes = team.each(lambda root: _count(binary, solids, root[0], 0, aside[:0], *_scratch()), roots)
    first_node = list(accumulate((nodes - 1 for nodes, _, _ in sizes), initial=nodes))
    first_packet = list(accumulate((packets for _, packets, _ in sizes), initial=packets))
    node = np.empty((first_node[-1], NODE_ROWS, WIDTH), np.float32)
    packet = np.empty((first_packet[-1], PACKET_ROWS, WIDTH), np.float32)
    _collapse_subtree(binary, shapes, 0, 0, least, 1, 0, node, packet, *_scratch())
    team.each(
        lambda job: _collapse_subtree(binary, shapes, *job[0], 0, *job[1:], node, packet, *_scratch()),
        zip(roots, first_node, first_packet, strict=False),
    )
    return node, packet


def _scratch() -> tuple[Array, Array]:
    """Returns one thread's scratch space: (a wide node's members; a stack of pairs of a binary node and its wide node)."""
    return np.empty(WIDTH, np.int64), np.empty((STACK_SIZE, 2), np.int64)


@device
def _collect_children(binary, root, members):
    """Collects the up to eight binary nodes that become the children of one wide node, largest first; returns their number."""
    members[0] = root
    count = 1
    while count < WIDTH:
        largest = -1
        area = np.float32(-1.0)
        for i in range(count):
            if binary.tree[members[i], 0] >= 0:
                of_this = half_area(load(binary.box, np.uintp(members[i]) * _EIGHT))
                if of_this > area:
                    largest, area = i, of_this
        if largest < 0:
            break
        child = binary.tree[members[largest], 0]
        members[largest] = child
        members[count] = child + 1
        count += 1
    return count


@entry
def _count(binary, solids, root, least, aside, members, stack):
    """Counts the results of collapsing a binary subtree: (wide nodes including the root, packets, deferred children).

    Children over at most `least` primitives are deferred: they are listed in `aside`, each with the number of the wide node that
    it becomes, and not counted.
    """
    stack[0, 0] = root
    top = 1
    nodes, packets, put_aside = 1, 0, 0
    while top > 0:
        top -= 1
        for i in range(_collect_children(binary, stack[top, 0], members)):
            member = members[i]
            if binary.tree[member, 0] >= 0:
                if binary.tree[member, 2] > least:
                    stack[top, 0] = member
                    top += 1
                else:
                    aside[put_aside, 0] = member
                    aside[put_aside, 1] = nodes
                    put_aside += 1
                nodes += 1
            elif binary.order[binary.tree[member, 1]] < solids:
                packets += 1
    return nodes, packets, put_aside


@device
def _fill_packet(packet, p, order, first, count, shapes):
    """Writes the primitives order[first : first + count], all of one kind, into packet p, by ascending number.

    Therefore the first of several lanes at equal distance has the lowest number.
    """
    triangles = len(shapes.triangle)
    for end in range(first + 1, first + count):
        primitive, lane = order[end], end
        while lane > first and order[lane - 1] > primitive:
            order[lane] = order[lane - 1]
            lane -= 1
        order[lane] = primitive
    for row in range(PACKET_ROWS):
        store(packet, np.uintp(p * PACKET_SIZE + row * WIDTH), splat(np.float32(np.nan)))
    for lane in range(count):
        primitive = order[first + lane]
        number = primitive
        if primitive < triangles and primitive >= shapes.first_curve:
            for k in range(3):
                packet[p, 6 + k, lane] = shapes.ends[primitive - shapes.first_curve, k]
            for corner in range(2):
                vertex = shapes.triangle[primitive, corner]
                for k in range(3):
                    packet[p, 3 * corner + k, lane] = shapes.position[vertex, k]
        elif primitive < triangles:
            for corner in range(3):
                vertex = shapes.triangle[primitive, corner]
                for k in range(3):
                    packet[p, 3 * corner + k, lane] = shapes.position[vertex, k]
        else:
            number += shapes.first_sphere - triangles
            for k in range(4):
                packet[p, k, lane] = shapes.sphere[primitive - triangles, k]
        store_int(packet, np.uintp(p * PACKET_SIZE + ROW_PRIMITIVE * WIDTH + lane), np.int32(number))


@entry
def _collapse_subtree(binary, shapes, root, wide_root, least, first_node, first_packet, node, packet, members, stack):
    """Fills wide node `wide_root` from the binary node `root`, and its subtree into nodes and packets from the given indices on.

    Traverses the subtree in the order of `_count`, and skips the children that `_count` defers.
    """
    triangles = len(shapes.triangle)
    solids = triangles + len(shapes.sphere)
    stack[0, 0] = root
    stack[0, 1] = wide_root
    top = 1
    nodes = first_node
    packets = first_packet
    while top > 0:
        top -= 1
        wide = stack[top, 1]
        count = _collect_children(binary, stack[top, 0], members)
        for lane in range(WIDTH):
            if lane >= count:
                for k in range(3):
                    node[wide, 2 * k, lane] = np.float32(np.inf)
                    node[wide, 2 * k + 1, lane] = np.float32(-np.inf)
                node[wide, ROW_CHILD, lane] = np.float32(0.0)
                continue
            member = members[lane]
            for k in range(3):
                lower = -binary.box[member, k]
                upper = binary.box[member, 4 + k]
                node[wide, 2 * k, lane] = lower - abs(lower) * _SLACK
                node[wide, 2 * k + 1, lane] = upper + abs(upper) * _SLACK
            first = binary.tree[member, 1]
            if binary.tree[member, 0] >= 0:
                child = nodes
                if binary.tree[member, 2] > least:
                    stack[top, 0] = member
                    stack[top, 1] = nodes
                    top += 1
                nodes += 1
            elif binary.order[first] >= solids:
                child = ~(4 * (binary.order[first] - solids) + INSTANCE)
            else:
                _fill_packet(packet, packets, binary.order, first, binary.tree[member, 2], shapes)
                kind = SPHERES
                if binary.order[first] < triangles:
                    kind = TRIANGLES if binary.order[first] < shapes.first_curve else CURVES
                child = ~(4 * packets + kind)
                packets += 1
            store_int(node, np.uintp(wide * NODE_SIZE + ROW_CHILD * WIDTH + lane), np.int32(child))
