"""Occlusion tests of many shadow rays, one traversal step of each in turn, as in walk.py."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import INSTANCE, NODE_SIZE, ROW_CHILD, WIDTH
from renderer.bvh.packet import meet_spheres, meet_triangles
from renderer.bvh.simd import bits, load_int, lowest_bit, select, store_int
from renderer.bvh.traverse import any_in_instance, place_at
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import NODES, OTHERS, PACKETS, clear, length, row
from renderer.kernel.backends.cpu.rows import Outcome, at, column, time_of
from renderer.kernel.backends.cpu.traversal_state import CHILD, LEVEL, OCCLUDED, TOP, three, word
from renderer.kernel.backends.cpu.walk import axes_of, boxes, go_on

__all__ = ["walk_shadow_rays"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_BIT = np.uint32(1)
_LAST = np.uint32(1 << (WIDTH - 1))
_1 = np.uintp(1)
_NODE = np.uintp(NODE_SIZE)
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_START, _END = column(Outcome, "start"), column(Outcome, "end")


@device
def _choose(node, stack, top):
    """Pops a pending child from a ray's stack: (the child, the stack's new top, whether the stack was empty)."""
    left = np.uint32(load_int(stack, top))
    base = word(stack, top + _1) * _NODE
    child = load_int(node, base + _CHILDREN + np.uintp(lowest_bit(left | _LAST)))
    rest = np.uint32(left & np.uint32(left - _BIT))
    store_int(stack, top, np.int32(rest))
    return child, select(rest == _NONE, top - LEVEL, top), top < LEVEL


@device
def _send_on(bvh, pool, stack, lists, which, count):
    """Sends the first `count` rays of a cleared list to their next step.

    Occluded rays and those with an empty stack are ended.

    A loop of its own, as in walk.py.
    """
    for k in range(count):
        number = row(lists, which, k)
        path = at(number, np.uintp(0))
        child, top, over = _choose(bvh.node, stack, word(pool, path + TOP))
        go_on(bvh, pool, lists, number, path, child, top, over | (pool[path + OCCLUDED] != _ZERO))


@subroutine
def _look_into_nodes(bvh, pool, stack, lists):
    out_of_line()
    count = length(lists, NODES)
    clear(lists, NODES)
    for k in range(count):
        path = at(row(lists, NODES, k), np.uintp(0))
        this = load_int(pool, path + CHILD)
        met = bits(boxes(bvh.node, np.uintp(np.uint32(this)) * _NODE, pool, path, _ONE)[0])
        top = word(pool, path + TOP)
        above = top + LEVEL
        store_int(stack, above, np.int32(met))
        store_int(stack, above + _1, this)
        store_int(pool, path + TOP, np.int32(select(met != _NONE, above, top)))
    _send_on(bvh, pool, stack, lists, NODES, count)


@subroutine
def _look_into_packets(bvh, motion, alone, pool, stack, lists):
    out_of_line()
    count = length(lists, PACKETS)
    clear(lists, PACKETS)
    for k in range(count):
        number = row(lists, PACKETS, k)
        path = at(number, np.uintp(0))
        place = place_at(bvh, ~load_int(pool, path + CHILD), alone, time_of(motion, pool, number))
        axes, shear, origin = axes_of(pool, path)
        blocked = bits(meet_triangles(place, axes, shear, origin, None, _ONE)[0]) != _NONE
        pool[path + OCCLUDED] = select(blocked, _ONE, _ZERO)
    _send_on(bvh, pool, stack, lists, PACKETS, count)


@subroutine
def _look_into_others(bvh, motion, alone, pool, stack, lists):
    out_of_line()
    count = length(lists, OTHERS)
    clear(lists, OTHERS)
    for k in range(count):
        number = row(lists, OTHERS, k)
        path = at(number, np.uintp(0))
        leaf = ~load_int(pool, path + CHILD)
        o = three(pool, path + _START)
        d, time = vec.sub(three(pool, path + _END), o), time_of(motion, pool, number)
        if bvh.instances is not None and leaf & INSTANCE:
            blocked = any_in_instance(bvh, alone, np.uintp(0), leaf >> 2, o, d, _ONE, time)
        else:
            blocked = bits(meet_spheres(place_at(bvh, leaf, alone, time), o, d, _ONE, None, None, None)[0]) != _NONE
        pool[path + OCCLUDED] = select(blocked, _ONE, _ZERO)
    _send_on(bvh, pool, stack, lists, OTHERS, count)


@device
def walk_shadow_rays(bvh, motion, alone, pool, stack, lists):
    """Tests whether each shadow ray on the list NODES is occluded, and writes column OCCLUDED.

    The rays were prepared by `start_traversal` (traversal_state.py). motion, alone, stack: as in walk.py.
    """
    while length(lists, NODES) + length(lists, PACKETS) + length(lists, OTHERS) > 0:
        _look_into_nodes(bvh, pool, stack, lists)
        _look_into_packets(bvh, motion, alone, pool, stack, lists)
        if length(lists, OTHERS) > 0:
            _look_into_others(bvh, motion, alone, pool, stack, lists)
