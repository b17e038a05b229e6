"""Traverses the BVH with many rays together, one step of each at a time, for closest hits or occlusion of shadow rays.

A single ray waits for its node, for the minimum over eight distances, and for mispredicted branches. Here one pass advances all
rays at a node by one step, and another all rays at a packet. Steps of different rays are independent and almost free of
unpredictable branches: a ray's next step is selected by appending its number to a list. The processor overlaps several rays, and
fetches data for one while it processes others.

Boxes and primitives are visited in the order and by the formulas of renderer/bvh/traverse.py, so the hits are the same.

`closest` is a compile-time flag: None for shadow rays, which end at any hit. Their stack entries contain a mask of the remaining
children; those of other rays contain the keys of the children.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.curves import intersect_curves
from renderer.bvh.hit_keys import hit_keys, key_limit, keys_beyond, masked, minimum_key, nearest, nearest_of
from renderer.bvh.layout import CURVES, LEAF_KIND, NODE_SIZE, ROW_CHILD, WIDTH
from renderer.bvh.node_test import intersect_boxes, is_nearer, primitive_of, tie_of
from renderer.bvh.packet import intersect_spheres, intersect_triangles
from renderer.bvh.prefetch import prefetch_child
from renderer.bvh.simd import bits, extract, load, load_int, lowest_bit, select, splat, store, store_int
from renderer.bvh.slabs import MORE
from renderer.bvh.traverse import (
    FACING,
    NO_PRIMITIVE,
    SHADOW_REACH,
    any_in_instance,
    closest_in_instance,
    is_instance,
    packet_address_at,
)
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import ENDED, NODES, OTHERS, PACKETS, append, clear, length, row
from renderer.kernel.backends.cpu.rows import Outcome, RowHit, at, column, time_of
from renderer.kernel.backends.cpu.traversal_state import (
    AXES,
    BEST,
    CHILD,
    FAR,
    HELD,
    HELD_SIZE,
    INVERSE,
    LEVEL,
    MARGIN,
    NEAR,
    OCCLUDED,
    ORIGIN,
    PLANES,
    SHEAR,
    TOP,
    load_index,
    load_vector,
)
from renderer.kernel.steps.state import Ray
from renderer.wide.values import as_ints

__all__ = ["CLOSEST", "traverse_rays"]

CLOSEST = np.bool_(True)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_BIT = np.uint32(1)
_LANE = np.int32(WIDTH - 1)  # mask of the lane in a key
_LAST = np.uint32(1 << (WIDTH - 1))
_LEAF_KIND = np.int32(LEAF_KIND)
_CURVES = np.int32(CURVES)
_NEARBY = 128  # nodes that fit the L1 cache; smaller trees are not prefetched
_1, _2 = np.uintp(1), np.uintp(2)
_W = np.uintp(WIDTH)
_NODE = np.uintp(NODE_SIZE)
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_O, _D = column(Ray, "o"), column(Ray, "d")
_START, _END = column(Outcome, "start"), column(Outcome, "end")
_U, _V, _PRIMITIVE, _INSTANCE = (column(RowHit, field) for field in ("u", "v", "primitive", "instance"))
_NODES, _PACKETS, _OTHERS, _ENDED = (np.uintp(k) for k in (NODES, PACKETS, OTHERS, ENDED))


@device
def _lanes(pool, place):
    """Returns three consecutive floats of the pool, from the flat index `place` on, each broadcast to eight lanes."""
    x, y, z = load_vector(pool, place)
    return splat(x), splat(y), splat(z)


@device
def _boxes(node, base, pool, path, t_max):
    """Returns which child boxes of a node the ray hits, and at which distances (`intersect_boxes`).

    path: flat offset in the pool of the ray's row. t_max: the distance up to which boxes count.
    """
    k = path + PLANES
    planes = load_index(pool, k), load_index(pool, k + _1), load_index(pool, k + _2)
    inverse, near, far = _lanes(pool, path + INVERSE), _lanes(pool, path + NEAR), _lanes(pool, path + FAR)
    return intersect_boxes(node, base, planes, inverse, near, far, _ZERO, t_max)


@device
def _list_for_next_step(bvh, pool, lists, number, path, child, top, over):
    """Appends a ray to the list of its next traversal step: node, triangle packet, other leaf, or end.

    number: the ray's row of the pool. path: the row's flat offset. child: the node or leaf to visit. top: the stack's top. over:
    whether the traversal has ended.
    """
    prefetch_child(bvh, child, _NEARBY)
    store_int(pool, path + CHILD, child)
    store_int(pool, path + TOP, np.int32(top))
    leaf = select((~child & _LEAF_KIND) == np.int32(0), _PACKETS, _OTHERS)
    append(lists, select(over, _ENDED, select(child >= np.int32(0), _NODES, leaf)), number)


@device
def _pop_nearest(node, stack, top, limit):
    """Pops the nearest pending child within `limit` from a ray's stack: (child, the stack's new top, True if there was none)."""
    key = load_int(stack, top + _W)
    while key > limit:
        top -= LEVEL
        key = load_int(stack, top + _W)
    base = load_index(stack, top + _W + _1) * _NODE
    child = load_int(node, base + _CHILDREN + np.uintp(np.uint32(key & _LANE)))
    rest = minimum_key(keys_beyond(load(stack, top), key))
    over = key < np.int32(0)
    store_int(stack, top + _W, select(over, key, rest))
    return child, select(rest > limit, top - LEVEL, top), over


@device
def _pop_any(node, stack, top):
    """Pops a pending child from a shadow ray's stack: (child, the stack's new top, True if the stack was empty)."""
    left = np.uint32(load_int(stack, top))
    base = load_index(stack, top + _1) * _NODE
    child = load_int(node, base + _CHILDREN + np.uintp(lowest_bit(left | _LAST)))
    rest = np.uint32(left & np.uint32(left - _BIT))
    store_int(stack, top, np.int32(rest))
    return child, select(rest == _NONE, top - LEVEL, top), top < LEVEL


@device
def _pop(node, pool, path, stack, closest):
    """Pops the next child to visit from a ray's stack: (child, the stack's new top, True if the traversal has ended).

    path: flat offset in the pool of the ray's row.
    """
    if closest is not None:
        return _pop_nearest(node, stack, load_index(pool, path + TOP), key_limit(pool[path + BEST]))
    child, top, over = _pop_any(node, stack, load_index(pool, path + TOP))
    return child, top, over | (pool[path + OCCLUDED] != _ZERO)


@device
def _advance_rays(bvh, pool, stack, lists, which, count, closest):
    """Pops the next child for each of the first `count` rays of a cleared list, and lists the ray for its next traversal step.

    This is a separate loop because the number of stack entries dropped is unpredictable: a misprediction here discards only this
    little work, not the box and triangle tests of following rays.
    """
    for k in range(count):
        number = row(lists, which, k)
        path = at(number, np.uintp(0))
        child, top, over = _pop(bvh.node, pool, path, stack, closest)
        _list_for_next_step(bvh, pool, lists, number, path, child, top, over)


@subroutine
def _visit_nodes(bvh, pool, stack, lists, closest):
    """Intersects the rays on the list NODES with the child boxes of their current node, and pushes the children that they hit."""
    never_inline()
    count = length(lists, NODES)
    clear(lists, NODES)
    for k in range(count):
        path = at(row(lists, NODES, k), np.uintp(0))
        this = load_int(pool, path + CHILD)
        base = np.uintp(np.uint32(this)) * _NODE
        top = load_index(pool, path + TOP)
        above = top + LEVEL
        if closest is not None:
            best = pool[path + BEST]
            met, distance = _boxes(bvh.node, base, pool, path, best)
            keys = hit_keys(met, distance)
            key = minimum_key(keys)
            store(stack, above, keys)
            store_int(stack, above + _W, key)
            store_int(stack, above + _W + _1, this)
            is_met = key <= key_limit(best)
        else:
            children = bits(_boxes(bvh.node, base, pool, path, SHADOW_REACH)[0])
            store_int(stack, above, np.int32(children))
            store_int(stack, above + _1, this)
            is_met = children != _NONE
        store_int(pool, path + TOP, np.int32(select(is_met, above, top)))
    _advance_rays(bvh, pool, stack, lists, NODES, count, closest)


@device
def _axes_of(pool, path):
    """Returns (order of the axes, shear, origin) of a ray for `intersect_triangles`.

    path: flat offset in the pool of the ray's row.
    """
    k = path + AXES
    return (
        (load_index(pool, k), load_index(pool, k + _1), load_index(pool, k + _2)),
        load_vector(pool, path + SHEAR),
        load_vector(pool, path + ORIGIN),
    )


@device
def _keep(pool, place, nearer, value):
    """Writes `value` to a flat index of the pool if `nearer` is True.

    Selects between integers, since for floats the compiler emits a branch.
    """
    store_int(pool, place, select(nearer, np.int32(as_ints(value)), load_int(pool, place)))


@device
def _test_packets(bvh, motion, alone, pool, stack, lists, count):
    """Intersects the first `count` rays of PACKETS with the triangles of their packet; stores the distances for `_keep_nearest`.

    This is a separate loop because the minimum over eight lanes and the lookup of its lane form a chain of short dependent steps,
    whose waiting instructions would fill the reorder buffer and keep the processor from starting the next ray.
    """
    for k in range(count):
        number = row(lists, PACKETS, k)
        path, held = at(number, np.uintp(0)), HELD + np.uintp(k) * HELD_SIZE
        place = packet_address_at(bvh, ~load_int(pool, path + CHILD), alone, time_of(motion, pool, number))
        axes, shear, origin = _axes_of(pool, path)
        limit = pool[path + BEST] * MORE
        hit, t, b, c, determinant = intersect_triangles(place, axes, shear, origin, pool[path + MARGIN], limit)
        inverse = splat(_ONE) / determinant
        store(stack, held, masked(hit, t * inverse))
        store(stack, held + _W, b * inverse)
        store(stack, held + _W + _W, c * inverse)


@device
def _tie(bvh, pool, path):
    """Returns the tie-breaking key (`tie_of`) of a ray's current hit. path: flat offset in the pool of the ray's row."""
    tie = load_int(pool, path + _PRIMITIVE)
    if bvh.instances is not None:
        tie = tie_of(load_int(pool, path + _INSTANCE), tie)
    return tie


@device
def _keep_nearest(bvh, pool, stack, lists, count):
    """Replaces the hit of each ray tested by `_test_packets` by the nearest intersection in its packet, if that is nearer."""
    for k in range(count):
        path, held = at(row(lists, PACKETS, k), np.uintp(0)), HELD + np.uintp(k) * HELD_SIZE
        best = pool[path + BEST]
        distance, lane = nearest_of(load(stack, held))
        found = primitive_of(bvh.packet, ~load_int(pool, path + CHILD), lane)
        present = load_int(pool, path + _PRIMITIVE)
        nearer = is_nearer(distance, found, best, _tie(bvh, pool, path))
        pool[path + BEST] = select(nearer, distance, best)
        _keep(pool, path + _U, nearer, stack[held + _W + np.uintp(lane)])
        _keep(pool, path + _V, nearer, stack[held + _W + _W + np.uintp(lane)])
        store_int(pool, path + _PRIMITIVE, select(nearer, found, present))
        if bvh.instances is not None:
            store_int(pool, path + _INSTANCE, select(nearer, NO_PRIMITIVE, load_int(pool, path + _INSTANCE)))


@device
def _occlude(bvh, motion, alone, pool, lists, count):
    """Tests whether the triangles of their packets occlude the first `count` shadow rays on the list PACKETS."""
    for k in range(count):
        number = row(lists, PACKETS, k)
        path = at(number, np.uintp(0))
        place = packet_address_at(bvh, ~load_int(pool, path + CHILD), alone, time_of(motion, pool, number))
        axes, shear, origin = _axes_of(pool, path)
        occluded = bits(intersect_triangles(place, axes, shear, origin, None, SHADOW_REACH)[0]) != _NONE
        pool[path + OCCLUDED] = select(occluded, _ONE, _ZERO)


@subroutine
def _visit_packets(bvh, motion, alone, pool, stack, lists, closest):
    """Intersects the rays on the list PACKETS with the triangles of their packets, and lists each for its next traversal step."""
    never_inline()
    count = length(lists, PACKETS)
    clear(lists, PACKETS)
    if closest is not None:
        _test_packets(bvh, motion, alone, pool, stack, lists, count)
        _keep_nearest(bvh, pool, stack, lists, count)
    else:
        _occlude(bvh, motion, alone, pool, lists, count)
    _advance_rays(bvh, pool, stack, lists, PACKETS, count, closest)


@device
def _meet_spheres(bvh, alone, pool, path, leaf, best, time):
    """Intersects a ray with the packet of spheres `leaf`, and replaces the ray's hit if one of the spheres is nearer.

    path: flat offset in the pool of the ray's row.
    """
    place = packet_address_at(bvh, leaf, alone, time)
    hit, t = intersect_spheres(place, load_vector(pool, path + _O), load_vector(pool, path + _D), best * MORE, None, None, None)
    distance, lane = nearest(hit, t)
    found = primitive_of(bvh.packet, leaf, lane)
    if is_nearer(distance, found, best, _tie(bvh, pool, path)):
        pool[path + BEST] = distance
        pool[path + _U] = _ZERO
        pool[path + _V] = _ZERO
        store_int(pool, path + _PRIMITIVE, found)
        store_int(pool, path + _INSTANCE, NO_PRIMITIVE)


@device
def _meet_curves(bvh, alone, pool, path, leaf, best, time):
    """Intersects a ray with the packet of curve segments `leaf`, and replaces the ray's hit if one of them is nearer.

    path: flat offset in the pool of the ray's row.
    """
    place = packet_address_at(bvh, leaf, alone, time)
    o, d = load_vector(pool, path + _O), load_vector(pool, path + _D)
    hit, t, u, v = intersect_curves(place, o, d, best * MORE, None, None, None)
    distance, lane = nearest(hit, t)
    found = primitive_of(bvh.packet, leaf, lane)
    if is_nearer(distance, found, best, _tie(bvh, pool, path)):
        pool[path + BEST] = distance
        pool[path + _U] = extract(u, lane)
        pool[path + _V] = extract(v, lane)
        store_int(pool, path + _PRIMITIVE, found)
        store_int(pool, path + _INSTANCE, NO_PRIMITIVE)


@device
def _meet_instance(bvh, alone, pool, path, instance, best, time):
    """Intersects a ray with an instance, and replaces the ray's hit if that of the instance is nearer.

    The instance's BVH is traversed by this ray alone, not together with other rays. path: flat offset in the pool of the ray's
    row.
    """
    o, d = load_vector(pool, path + _O), load_vector(pool, path + _D)
    holder = load_int(pool, path + _INSTANCE)
    found = closest_in_instance(bvh, alone, np.uintp(0), instance, o, d, best, holder, time, None, FACING)
    if found[1] != NO_PRIMITIVE:
        pool[path + BEST] = found[0]
        pool[path + _U] = found[2]
        pool[path + _V] = found[3]
        store_int(pool, path + _PRIMITIVE, found[1])
        store_int(pool, path + _INSTANCE, np.int32(instance))


@device
def _occlude_by_others(bvh, alone, pool, path, leaf, time):
    """Tests whether an instance or a packet of spheres or curves, `leaf`, occludes a shadow ray.

    path: flat offset in the pool of the ray's row.
    """
    o = load_vector(pool, path + _START)
    d = vec.sub(load_vector(pool, path + _END), o)
    if bvh.instances is not None and is_instance(bvh, leaf):
        occluded = any_in_instance(bvh, alone, np.uintp(0), leaf >> 2, o, d, SHADOW_REACH, time)
    elif bvh.curves is not None and (leaf & _LEAF_KIND) == _CURVES:
        place = packet_address_at(bvh, leaf, alone, time)
        occluded = bits(intersect_curves(place, o, d, SHADOW_REACH, None, None, None)[0]) != _NONE
    else:
        occluded = (
            bits(intersect_spheres(packet_address_at(bvh, leaf, alone, time), o, d, SHADOW_REACH, None, None, None)[0]) != _NONE
        )
    pool[path + OCCLUDED] = select(occluded, _ONE, _ZERO)


@subroutine
def _visit_others(bvh, motion, alone, pool, stack, lists, closest):
    """Intersects the rays whose next leaf is an instance or a packet of spheres or curves (list OTHERS) with that leaf."""
    never_inline()
    count = length(lists, OTHERS)
    clear(lists, OTHERS)
    for k in range(count):
        number = row(lists, OTHERS, k)
        path = at(number, np.uintp(0))
        leaf, time = ~load_int(pool, path + CHILD), time_of(motion, pool, number)
        if closest is None:
            _occlude_by_others(bvh, alone, pool, path, leaf, time)
        elif bvh.instances is not None and is_instance(bvh, leaf):
            _meet_instance(bvh, alone, pool, path, leaf >> 2, pool[path + BEST], time)
        elif bvh.curves is not None and (leaf & _LEAF_KIND) == _CURVES:
            _meet_curves(bvh, alone, pool, path, leaf, pool[path + BEST], time)
        else:
            _meet_spheres(bvh, alone, pool, path, leaf, pool[path + BEST], time)
    _advance_rays(bvh, pool, stack, lists, OTHERS, count, closest)


@device
def traverse_rays(bvh, motion, alone, pool, stack, lists, closest):
    """Traverses the BVH with all rays on the list NODES until each is on the list ENDED.

    closest: CLOSEST to find the closest hits, written to RowHit, with their distance in BEST; None to test whether shadow rays
    are occluded, written to OCCLUDED. The rays must be prepared by `start_traversal` (traversal_state.py). motion: None for a
    scene without motion. alone: the stack (from `new_stack`) for rays traced singly. stack: the stacks from `new_stacks`.
    """
    while length(lists, NODES) + length(lists, PACKETS) + length(lists, OTHERS) > 0:
        _visit_nodes(bvh, pool, stack, lists, closest)
        _visit_packets(bvh, motion, alone, pool, stack, lists, closest)
        if length(lists, OTHERS) > 0:
            _visit_others(bvh, motion, alone, pool, stack, lists, closest)
