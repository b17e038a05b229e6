"""Folds the binary tree into 8-wide nodes and its leaves into packets."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import INSTANCE, NODE_SIZE, PACKET_SIZE, ROW_CHILD, ROW_PRIMITIVE, SPHERES, STACK_SIZE, TRIANGLES, WIDTH
from renderer.bvh.simd import store_int
from renderer.jit import builder, device

__all__ = ["count_wide_nodes", "fold", "half_area"]

# Two units in the last place on each side: with the slack that traversal keeps for the origin, no rounding can lose a hit.
_SLACK = np.float32(4 * 2.0**-24)


@device
def half_area(box, i):
    """Half the surface of box i, kept as (-lower, upper)."""
    dx = box[i, 0] + box[i, 4]
    dy = box[i, 1] + box[i, 5]
    dz = box[i, 2] + box[i, 6]
    return dx * dy + dy * dz + dz * dx


@device
def _open(tree_box, tree, root, members):
    """The up to eight binary nodes that become the children of one wide node; opens the largest first. Returns how many."""
    members[0] = root
    count = 1
    while count < WIDTH:
        largest = -1
        area = np.float32(-1.0)
        for i in range(count):
            if tree[members[i], 0] >= 0 and half_area(tree_box, members[i]) > area:
                largest = i
                area = half_area(tree_box, members[i])
        if largest < 0:
            break
        child = tree[members[largest], 0]
        members[largest] = child
        members[count] = child + 1
        count += 1
    return count


@builder
def count_wide_nodes(tree_box, tree, order, solids):
    """How many wide nodes and packets the folded tree has. solids: the number of triangles and spheres."""
    members = np.empty(WIDTH, np.int32)
    stack = np.empty(STACK_SIZE, np.int32)
    stack[0] = 0
    top = 1
    nodes = 0
    packets = 0
    while top > 0:
        top -= 1
        nodes += 1
        for i in range(_open(tree_box, tree, stack[top], members)):
            if tree[members[i], 0] >= 0:
                stack[top] = members[i]
                top += 1
            elif order[tree[members[i], 1]] < solids:
                packets += 1
    return nodes, packets


@device
def _fill_packet(packet, p, order, first, count, position, triangle, sphere, first_sphere):
    """Writes the primitives order[first : first + count], all of one kind, into packet p."""
    triangles = len(triangle)
    packet[p] = np.float32(np.nan)
    for lane in range(count):
        primitive = order[first + lane]
        number = primitive
        if primitive < triangles:
            for corner in range(3):
                for k in range(3):
                    packet[p, 3 * corner + k, lane] = position[triangle[primitive, corner], k]
        else:
            number += first_sphere - triangles
            for k in range(4):
                packet[p, k, lane] = sphere[primitive - triangles, k]
        store_int(packet, np.uintp(p * PACKET_SIZE + ROW_PRIMITIVE * WIDTH + lane), np.int32(number))


@builder
def fold(tree_box, tree, order, position, triangle, sphere, first_sphere, node, packet):
    """Fills `node` and `packet`, of the sizes that `count_wide_nodes` gave, from the binary tree.

    order: which triangle, sphere (from len(triangle) on) or instance (from there on) stands where; first_sphere: the
    primitive number of the first sphere.
    """
    solids = len(triangle) + len(sphere)
    members = np.empty(WIDTH, np.int32)
    stack = np.empty((STACK_SIZE, 2), np.int32)  # a binary node, the wide node it becomes
    stack[0, 0] = 0
    stack[0, 1] = 0
    top = 1
    nodes = 1
    packets = 0
    while top > 0:
        top -= 1
        wide = np.int64(stack[top, 1])
        count = _open(tree_box, tree, stack[top, 0], members)
        for lane in range(WIDTH):
            if lane >= count:
                for k in range(3):
                    node[wide, 2 * k, lane] = np.float32(np.inf)
                    node[wide, 2 * k + 1, lane] = np.float32(-np.inf)
                node[wide, ROW_CHILD, lane] = np.float32(0.0)
                continue
            member = members[lane]
            for k in range(3):
                lower = -tree_box[member, k]
                upper = tree_box[member, 4 + k]
                node[wide, 2 * k, lane] = lower - abs(lower) * _SLACK
                node[wide, 2 * k + 1, lane] = upper + abs(upper) * _SLACK
            if tree[member, 0] >= 0:
                child = nodes
                stack[top, 0] = member
                stack[top, 1] = nodes
                top += 1
                nodes += 1
            elif order[tree[member, 1]] >= solids:
                child = ~(4 * (order[tree[member, 1]] - solids) + INSTANCE)
            else:
                _fill_packet(packet, packets, order, tree[member, 1], tree[member, 2], position, triangle, sphere, first_sphere)
                child = ~(4 * packets + (TRIANGLES if order[tree[member, 1]] < len(triangle) else SPHERES))
                packets += 1
            store_int(node, np.uintp(wide * NODE_SIZE + ROW_CHILD * WIDTH + lane), np.int32(child))
