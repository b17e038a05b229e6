"""Closest-hit traversal of many rays, one step of each in turn.

A single ray waits for its node, for the minimum over eight distances, and for mispredicted branches. Here one pass advances all
rays at a node by one step, and another all rays at a packet. Steps of different rays are independent and almost free of
unpredictable branches: a ray's next step is chosen by appending its number to a list. The processor overlaps several rays, and
data for one ray is fetched meanwhile.

Boxes and primitives are visited in the order and by the formulas of renderer/bvh/traverse.py, so the hits are the same.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.hit_keys import beyond, key_limit, least, masked, nearest, nearest_of, ranked
from renderer.bvh.layout import INSTANCE, NODE_SIZE, PACKET_SIZE, ROW_CHILD, ROW_PRIMITIVE, WIDTH
from renderer.bvh.packet import meet_spheres, meet_triangles
from renderer.bvh.prefetch import ask_for
from renderer.bvh.simd import (
    fma,
    less_equal,
    load,
    load_int,
    maximum,
    minimum,
    select,
    splat,
    store,
    store_int,
)
from renderer.bvh.slabs import MORE
from renderer.bvh.traverse import NO_PRIMITIVE, closest_in_instance, place_at
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel.backends.cpu.lists import ENDED, NODES, OTHERS, PACKETS, append, clear, length, row
from renderer.kernel.backends.cpu.rows import RowHit, at, column, time_of
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
    ORIGIN,
    PLANES,
    SHEAR,
    TOP,
    three,
    word,
)
from renderer.kernel.steps.state import Ray
from renderer.wide.values import as_ints

__all__ = ["axes_of", "boxes", "go_on", "walk"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LANE = np.int32(WIDTH - 1)  # mask of the lane in a key
_LEAF_KIND = np.int32(3)
_ANY_PRIMITIVE = np.int32(2**31 - 1)
_WORLD = np.int32(-1)
_NEARBY = 128  # nodes that fit the L1 cache; smaller trees are not prefetched
_1, _2 = np.uintp(1), np.uintp(2)
_W = np.uintp(WIDTH)
_NODE = np.uintp(NODE_SIZE)
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_PRIMITIVES = np.uintp(ROW_PRIMITIVE * WIDTH)
_PACKET = np.uintp(PACKET_SIZE)
_O, _D = column(Ray, "o"), column(Ray, "d")
_U, _V, _PRIMITIVE, _INSTANCE = (column(RowHit, field) for field in ("u", "v", "primitive", "instance"))
_NODES, _PACKETS, _OTHERS, _ENDED = (np.uintp(k) for k in (NODES, PACKETS, OTHERS, ENDED))


@device
def boxes(node, base, pool, path, t_max):
    """Intersects a row's ray with a node's eight boxes: (mask of boxes hit, f32x8 entry distances).

    path: the row's flat offset.
    """
    x, y, z = word(pool, path + PLANES), word(pool, path + PLANES + _1), word(pool, path + PLANES + _2)
    ix, iy, iz = three(pool, path + INVERSE)
    near_x, near_y, near_z = three(pool, path + NEAR)
    far_x, far_y, far_z = three(pool, path + FAR)
    x_near = fma(load(node, base + x), splat(ix), splat(near_x))
    x_far = fma(load(node, base + (x ^ _W)), splat(ix), splat(far_x))
    y_near = fma(load(node, base + y), splat(iy), splat(near_y))
    y_far = fma(load(node, base + (y ^ _W)), splat(iy), splat(far_y))
    z_near = fma(load(node, base + z), splat(iz), splat(near_z))
    z_far = fma(load(node, base + (z ^ _W)), splat(iz), splat(far_z))
    # As in renderer/bvh/traverse.py, NaN propagates: a ray with NaN hits nothing.
    entered = maximum(maximum(x_near, y_near), maximum(splat(_ZERO), z_near))
    left = minimum(minimum(x_far, y_far), minimum(splat(t_max), z_far))
    return less_equal(entered, left), entered


@device
def go_on(bvh, pool, lists, number, path, child, top, over):
    """Appends a ray to the list of its next step. over: whether its traversal has ended."""
    ask_for(bvh, child, _NEARBY)
    store_int(pool, path + CHILD, child)
    store_int(pool, path + TOP, np.int32(top))
    leaf = select((~child & _LEAF_KIND) == np.int32(0), _PACKETS, _OTHERS)
    append(lists, select(over, _ENDED, select(child >= np.int32(0), _NODES, leaf)), number)


@device
def _choose(node, stack, top, limit):
    """Pops the nearest pending child within `limit` from a ray's stack: (child, the stack's new top, whether there is none)."""
    key = load_int(stack, top + _W)
    while key > limit:
        top -= LEVEL
        key = load_int(stack, top + _W)
    base = word(stack, top + _W + _1) * _NODE
    child = load_int(node, base + _CHILDREN + np.uintp(np.uint32(key & _LANE)))
    rest = least(beyond(load(stack, top), key))
    over = key < np.int32(0)
    store_int(stack, top + _W, select(over, key, rest))
    return child, select(rest > limit, top - LEVEL, top), over


@device
def _send_on(bvh, pool, stack, lists, which, count):
    """Sends the first `count` rays of a cleared list to the nearest pending child on their stacks.

    A loop of its own: the number of stack entries dropped is unpredictable, and a misprediction here discards only this little
    work, not the box and triangle tests of following rays.
    """
    for k in range(count):
        number = row(lists, which, k)
        path = at(number, np.uintp(0))
        child, top, over = _choose(bvh.node, stack, word(pool, path + TOP), key_limit(pool[path + BEST]))
        go_on(bvh, pool, lists, number, path, child, top, over)


@subroutine
def _look_into_nodes(bvh, pool, stack, lists):
    out_of_line()
    node = bvh.node
    count = length(lists, NODES)
    clear(lists, NODES)
    for k in range(count):
        path = at(row(lists, NODES, k), np.uintp(0))
        this = load_int(pool, path + CHILD)
        best = pool[path + BEST]
        met, distance = boxes(node, np.uintp(np.uint32(this)) * _NODE, pool, path, best)
        keys = ranked(met, distance)
        key = least(keys)
        top = word(pool, path + TOP)
        above = top + LEVEL
        store(stack, above, keys)
        store_int(stack, above + _W, key)
        store_int(stack, above + _W + _1, this)
        store_int(pool, path + TOP, np.int32(select(key <= key_limit(best), above, top)))
    _send_on(bvh, pool, stack, lists, NODES, count)


@device
def axes_of(pool, path):
    """Returns (rows of the axes, shear, origin) of a row's ray, for `meet_triangles`."""
    k = path + AXES
    return (word(pool, k), word(pool, k + _1), word(pool, k + _2)), three(pool, path + SHEAR), three(pool, path + ORIGIN)


@device
def _keep(pool, place, nearer, value):
    """Stores a float where `nearer` is true. Selects on integers, since for floats the compiler emits a branch."""
    store_int(pool, place, select(nearer, np.int32(as_ints(value)), load_int(pool, place)))


@device
def _test_packets(bvh, motion, alone, pool, stack, lists, count):
    """Intersects the first `count` listed rays with the triangles of their packets; stores the results for `_keep_nearest`.

    A separate loop: the minimum over eight lanes and the lookup of its lane form a chain of short dependent steps, whose waiting
    instructions would fill the reorder buffer and keep the processor from starting the next ray.
    """
    for k in range(count):
        number = row(lists, PACKETS, k)
        path, held = at(number, np.uintp(0)), HELD + np.uintp(k) * HELD_SIZE
        place = place_at(bvh, ~load_int(pool, path + CHILD), alone, time_of(motion, pool, number))
        axes, shear, origin = axes_of(pool, path)
        limit = pool[path + BEST] * MORE
        hit, t, b, c, determinant = meet_triangles(place, axes, shear, origin, pool[path + MARGIN], limit)
        inverse = splat(_ONE) / determinant
        store(stack, held, masked(hit, t * inverse))
        store(stack, held + _W, b * inverse)
        store(stack, held + _W + _W, c * inverse)


@device
def _keep_nearest(bvh, pool, stack, lists, count):
    """Updates each ray's hit with the nearest stored intersection, where it is nearer than the present hit."""
    for k in range(count):
        path, held = at(row(lists, PACKETS, k), np.uintp(0)), HELD + np.uintp(k) * HELD_SIZE
        leaf = ~load_int(pool, path + CHILD)
        best = pool[path + BEST]
        distance, lane = nearest_of(load(stack, held))
        found = load_int(bvh.packet, np.uintp(leaf >> 2) * _PACKET + _PRIMITIVES + np.uintp(lane))
        present = load_int(pool, path + _PRIMITIVE)
        tie = present
        if bvh.instances is not None:
            tie = select(load_int(pool, path + _INSTANCE) > _WORLD, _ANY_PRIMITIVE, present)
        # False for a miss, whose distance is NaN.
        nearer = (distance < best) | ((distance == best) & (found < tie))
        pool[path + BEST] = select(nearer, distance, best)
        _keep(pool, path + _U, nearer, stack[held + _W + np.uintp(lane)])
        _keep(pool, path + _V, nearer, stack[held + _W + _W + np.uintp(lane)])
        store_int(pool, path + _PRIMITIVE, select(nearer, found, present))
        if bvh.instances is not None:
            store_int(pool, path + _INSTANCE, select(nearer, NO_PRIMITIVE, load_int(pool, path + _INSTANCE)))


@subroutine
def _look_into_packets(bvh, motion, alone, pool, stack, lists):
    out_of_line()
    count = length(lists, PACKETS)
    clear(lists, PACKETS)
    _test_packets(bvh, motion, alone, pool, stack, lists, count)
    _keep_nearest(bvh, pool, stack, lists, count)
    _send_on(bvh, pool, stack, lists, PACKETS, count)


@device
def _meet_spheres(bvh, alone, pool, path, leaf, best, time):
    """Intersects a row's ray with a packet of spheres, and updates its hit."""
    place = place_at(bvh, leaf, alone, time)
    hit, t = meet_spheres(place, three(pool, path + _O), three(pool, path + _D), best * MORE, None, None, None)
    distance, lane = nearest(hit, t)
    found = load_int(bvh.packet, np.uintp(leaf >> 2) * _PACKET + _PRIMITIVES + np.uintp(lane))
    tie = load_int(pool, path + _PRIMITIVE)
    if bvh.instances is not None:
        tie = select(load_int(pool, path + _INSTANCE) > _WORLD, _ANY_PRIMITIVE, tie)
    if distance < best or (distance == best and found < tie):
        pool[path + BEST] = distance
        pool[path + _U] = _ZERO
        pool[path + _V] = _ZERO
        store_int(pool, path + _PRIMITIVE, found)
        store_int(pool, path + _INSTANCE, NO_PRIMITIVE)


@device
def _meet_instance(bvh, alone, pool, path, instance, best, time):
    """Intersects a row's ray with an instance, whose tree is traversed by this ray alone, and updates its hit."""
    o, d = three(pool, path + _O), three(pool, path + _D)
    holder = load_int(pool, path + _INSTANCE)
    found = closest_in_instance(bvh, alone, np.uintp(0), instance, o, d, best, holder, time, None)
    if found[1] != NO_PRIMITIVE:
        pool[path + BEST] = found[0]
        pool[path + _U] = found[2]
        pool[path + _V] = found[3]
        store_int(pool, path + _PRIMITIVE, found[1])
        store_int(pool, path + _INSTANCE, np.int32(instance))


@subroutine
def _look_into_others(bvh, motion, alone, pool, stack, lists):
    out_of_line()
    count = length(lists, OTHERS)
    clear(lists, OTHERS)
    for k in range(count):
        number = row(lists, OTHERS, k)
        path = at(number, np.uintp(0))
        leaf = ~load_int(pool, path + CHILD)
        best = pool[path + BEST]
        time = time_of(motion, pool, number)
        if bvh.instances is not None and leaf & INSTANCE:
            _meet_instance(bvh, alone, pool, path, leaf >> 2, best, time)
        else:
            _meet_spheres(bvh, alone, pool, path, leaf, best, time)
        child, top, over = _choose(bvh.node, stack, word(pool, path + TOP), key_limit(pool[path + BEST]))
        go_on(bvh, pool, lists, number, path, child, top, over)


@device
def walk(bvh, motion, alone, pool, stack, lists):
    """Finds the closest hits of the rays on the list NODES; writes RowHit, and the distance to BEST.

    The rays were prepared by `start_traversal` (traversal_state.py). motion: of renderer/arrays/scene_features.py; alone: from
    `new_stack`, for rays traced singly; stack: from `new_stacks`.
    """
    while length(lists, NODES) + length(lists, PACKETS) + length(lists, OTHERS) > 0:
        _look_into_nodes(bvh, pool, stack, lists)
        _look_into_packets(bvh, motion, alone, pool, stack, lists)
        if length(lists, OTHERS) > 0:
            _look_into_others(bvh, motion, alone, pool, stack, lists)
