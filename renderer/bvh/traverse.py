"""Rays through the tree: the closest hit, and whether there is any.

The boxes' slabs are met by one fused multiply-add a plane. Its rounding is made good by a slack that each ray adds to its
own constants (and that the builder adds to the boxes), so that no box is missed that holds a hit: flat boxes and boxes that
touch along an edge included. A node's children are visited from the nearest to the farthest that is not farther than the
hit so far: a vector of keys, distances whose last bits tell the lane, is all that there is to keep of a node, and the next
key is found while the leaf of the last one is looked at. Shadow rays take them as they come, leaves first.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.ahead import ask_for
from renderer.bvh.entering import into
from renderer.bvh.keys import beyond, key_limit, least, nearest, ranked
from renderer.bvh.layout import (
    INSTANCE,
    MAX_LEVELS,
    NODE_SIZE,
    PACKET_ROWS,
    PACKET_SIZE,
    ROW_CHILD,
    ROW_PRIMITIVE,
    SPHERES,
    WIDTH,
)
from renderer.bvh.motion import step_at
from renderer.bvh.packet import meet_spheres, meet_triangles
from renderer.bvh.simd import (
    address,
    bits,
    extract,
    fma,
    less_equal,
    load,
    load_int,
    lowest_bit,
    maximum,
    minimum,
    select,
    splat,
    store,
    store_int,
)
from renderer.jit import device, out_of_line, subroutine

__all__ = [
    "NO_PRIMITIVE",
    "Hit",
    "any_hit",
    "any_in_instance",
    "camera_root",
    "closest_hit",
    "closest_in_instance",
    "new_stack",
    "place_at",
    "shadow_root",
]

NO_PRIMITIVE = np.int32(-1)
_WORLD = np.int32(-1)
_ROOT = np.int32(0)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-18)
_SLACK = np.float32(4 * 2.0**-24)
_W = np.uintp(WIDTH)
_NODE = np.uintp(NODE_SIZE)
_NEARBY = 8192  # nodes that the caches of a core hold: a ray that goes alone waits for little there, and asking takes time
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_PRIMITIVES = np.uintp(ROW_PRIMITIVE * WIDTH)
_PACKET = np.uintp(PACKET_SIZE)
_BIT = np.uint32(1)
_LANE = np.int32(WIDTH - 1)  # of a key: the lane
_ENTRY = np.uintp(WIDTH + 2)  # words on the stack for the children of a node that wait: keys, the least of them, the node
_BETWEEN = np.uintp(2 * MAX_LEVELS * (WIDTH + 2))  # where on it a packet between two keys is put


class Hit(NamedTuple):
    """What a ray meets first."""

    t: float  # along the ray, in lengths of its direction
    primitive: int  # triangles first, then spheres; NO_PRIMITIVE where nothing is met
    u: float  # barycentric coordinates of the triangle's corners b and c; 0 for spheres
    v: float
    instance: int  # whose space the primitive is in; -1 for the world's
    time: Any = None  # of the ray, as `closest_hit` was told it


def new_stack() -> npt.NDArray[np.float32]:
    """The scratch space of one thread's traversals, for the kernel that it calls."""
    # For the world's tree, and an instance's; then for a packet between two keys.
    return np.empty(2 * MAX_LEVELS * int(_ENTRY) + PACKET_SIZE, np.float32)


@device
def _slab(o, d):
    """What a ray needs of one axis: (f32x8 of 1/d, of the near plane's constant, of the far plane's, the near row's offset,
    the far row's, and 1/d once more).

    A component near zero is taken as +-1e-18: 0 * inf would be NaN, and turn a ray into a walk of the whole tree.
    """
    size = abs(d)
    inverse = _ONE / math.copysign(_TINY if size < _TINY else size, d)
    constant = -o * inverse
    slack = abs(constant) * _SLACK
    near = np.uintp(0) if inverse > _ZERO else _W
    return splat(inverse), splat(constant - slack), splat(constant + slack), near, _W - near, inverse


@device
def _boxes(node, base, x, y, z, t_max):
    """The ray against a node's eight boxes: (mask of those met, f32x8 distances)."""
    two = _W + _W
    four = two + two
    x_near = fma(load(node, base + x[3]), x[0], x[1])
    x_far = fma(load(node, base + x[4]), x[0], x[2])
    y_near = fma(load(node, base + two + y[3]), y[0], y[1])
    y_far = fma(load(node, base + two + y[4]), y[0], y[2])
    z_near = fma(load(node, base + four + z[3]), z[0], z[1])
    z_far = fma(load(node, base + four + z[4]), z[0], z[2])
    # NaN, which both hand on from their second operand, must reach the end: a ray that is no number meets nothing, where
    # it would else walk in circles through lanes without a child.
    near = maximum(maximum(x_near, y_near), maximum(splat(_ZERO), z_near))
    far = minimum(minimum(x_far, y_far), minimum(splat(t_max), z_far))
    return less_equal(near, far), near


@device
def _axes(o, d, inverse):
    """The watertight test's frame, axes permuted so that the last is the direction's largest: row offsets, shear, origin.

    Choices of values, not branches: which axis it is cannot be predicted.
    """
    ax, ay, az = abs(d[0]), abs(d[1]), abs(d[2])
    first = ax > max(ay, az)
    second = ay > az
    zero = np.uintp(0)
    two = _W + _W
    kx = select(first, _W, select(second, two, zero))
    ky = select(first, two, select(second, zero, _W))
    kz = select(first, zero, select(second, _W, two))
    dx = select(first, d[1], select(second, d[2], d[0]))
    dy = select(first, d[2], select(second, d[0], d[1]))
    ox = select(first, o[1], select(second, o[2], o[0]))
    oy = select(first, o[2], select(second, o[0], o[1]))
    oz = select(first, o[0], select(second, o[1], o[2]))
    scale = select(first, inverse[0], select(second, inverse[1], inverse[2]))
    return (kx, ky, kz), (dx * scale, dy * scale, scale), (ox, oy, oz)


@device
def _place(packet, leaf):
    """The address of a leaf's packet."""
    return address(packet, np.uintp(leaf >> 2) * _PACKET)


@subroutine
def _put_between(packet, leaf, keys, time, stack):
    """Puts a leaf's packet on the stack as it is at a time of the shutter. keys: how often it is there."""
    out_of_line()
    step, share = step_at(time, keys)
    first = (np.uintp(leaf >> 2) + np.uintp(step)) * _PACKET
    part = splat(share)
    for row in range(PACKET_ROWS - 1):
        offset = np.uintp(row) * _W
        before = load(packet, first + offset)
        store(stack, _BETWEEN + offset, fma(load(packet, first + _PACKET + offset) - before, part, before))


@device
def place_at(bvh, leaf, stack, time):
    """As `_place`, at a time of the shutter; the stack holds one packet that is none of the tree's."""
    if time is not None and (leaf >> 2) >= bvh.keyed[0]:
        _put_between(bvh.packet, leaf, bvh.keyed[1], time, stack)
        return address(stack, _BETWEEN)
    return _place(bvh.packet, leaf)


@device
def _met(place, leaf, o, d, axes, shear, permuted, t_max):
    """As `meet_triangles`, of a leaf of either kind, its packet at that address."""
    if leaf & SPHERES:
        hit, t = meet_spheres(place, o, d, t_max)
        return hit, t, splat(_ZERO), splat(_ZERO), splat(_ONE)
    return meet_triangles(place, axes, shear, permuted, t_max)


@device
def _meet(packet, place, leaf, o, d, axes, shear, permuted, best, primitive, u, v):
    """What a leaf's packet makes of the nearest hit so far: (distance, primitive, u, v)."""
    hit, t, b, c, determinant = _met(place, leaf, o, d, axes, shear, permuted, best)
    if bits(hit) != np.uint32(0):
        inverse = splat(_ONE) / determinant
        distance, lane = nearest(hit, t * inverse)
        if distance < best:
            best = distance
            u = extract(b * inverse, lane)
            v = extract(c * inverse, lane)
            primitive = load_int(packet, np.uintp(leaf >> 2) * _PACKET + _PRIMITIVES + np.uintp(lane))
    return best, primitive, u, v


@device
def _enter(node, base, x, y, z, best):
    """The children of a node that the ray meets nearer than `best`: their keys, and the least of them."""
    met, distance = _boxes(node, base, x, y, z, best)
    keys = ranked(met, distance)
    return keys, least(keys)


@device
def _child(node, base, lane):
    return load_int(node, base + _CHILDREN + np.uintp(np.uint32(lane)))


@device
def _push(stack, top, base, keys, key):
    """Puts a node's other children on the stack: its new top."""
    store(stack, top, keys)
    store_int(stack, top + _W, key)
    store_int(stack, top + _W + np.uintp(1), np.int32(base // _NODE))
    return top + _ENTRY


@device
def _pop(stack, top):
    """The (node, keys, least key) on top of the stack."""
    key = load_int(stack, top + _W)
    base = np.uintp(np.uint32(load_int(stack, top + _W + np.uintp(1)))) * _NODE
    return base, load(stack, top), key


@subroutine
def closest_in_instance(bvh, stack, bottom, number, o, d, best, time):
    """The nearest hit nearer than `best` in an instance's tree: (distance, primitive, u, v); NO_PRIMITIVE where there is none."""
    out_of_line()
    o, d = into(bvh, number, o, d, time)
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, (x[5], y[5], z[5]))
    primitive, u, v = NO_PRIMITIVE, _ZERO, _ZERO
    top = bottom
    base = np.uintp(bvh.instance_root[number]) * _NODE
    keys, key = _enter(bvh.node, base, x, y, z, best)
    while True:
        if key > key_limit(best):
            if top == bottom:
                return best, primitive, u, v
            top -= _ENTRY
            base, keys, key = _pop(stack, top)
            continue
        child = _child(bvh.node, base, key & _LANE)
        keys = beyond(keys, key)
        key = least(keys)
        if child >= 0:
            if key <= key_limit(best):
                top = _push(stack, top, base, keys, key)
            base = np.uintp(child) * _NODE
            keys, key = _enter(bvh.node, base, x, y, z, best)
            continue
        place = _place(bvh.packet, ~child)
        best, primitive, u, v = _meet(bvh.packet, place, ~child, o, d, axes, shear, permuted, best, primitive, u, v)


@device
def camera_root(bvh):
    """The node at which the camera's rays begin."""
    if bvh.begin is not None:
        return bvh.begin[0]
    return _ROOT


@device
def shadow_root(bvh):
    """The node at which shadow rays begin."""
    if bvh.begin is not None:
        return bvh.begin[1]
    return _ROOT


@device
def closest_hit(bvh, stack, o, d, t_max, time=None, root=_ROOT):
    """The nearest primitive along o + t d with 0 < t < t_max: a Hit. stack: from `new_stack`.

    time: of the shutter, 0 ... 1; None where nothing moves, or in the middle. root: the node to begin at.
    """
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, (x[5], y[5], z[5]))
    best, primitive, u, v = t_max, NO_PRIMITIVE, _ZERO, _ZERO
    instance = _WORLD
    top = np.uintp(0)
    base = np.uintp(np.uint32(root)) * _NODE
    keys, key = _enter(bvh.node, base, x, y, z, best)
    while True:
        if key > key_limit(best):
            if top == np.uintp(0):
                break
            top -= _ENTRY
            base, keys, key = _pop(stack, top)
            continue
        child = _child(bvh.node, base, key & _LANE)
        keys = beyond(keys, key)
        key = least(keys)  # wanted next, and found while the leaf is looked at
        ask_for(bvh, _child(bvh.node, base, key & _LANE), _NEARBY)
        if child >= 0:
            if key <= key_limit(best):
                top = _push(stack, top, base, keys, key)
            base = np.uintp(child) * _NODE
            keys, key = _enter(bvh.node, base, x, y, z, best)
            continue
        leaf = ~child
        if bvh.instances is not None and leaf & INSTANCE:
            found = closest_in_instance(bvh, stack, top, leaf >> 2, o, d, best, time)
            if found[1] != NO_PRIMITIVE:
                best, primitive, u, v = found
                instance = np.int32(leaf >> 2)
        else:
            nearer = best
            place = place_at(bvh, leaf, stack, time)
            best, primitive, u, v = _meet(bvh.packet, place, leaf, o, d, axes, shear, permuted, best, primitive, u, v)
            if best < nearer:
                instance = _WORLD
    return Hit(best, primitive, u, v, instance, time)


@subroutine
def any_in_instance(bvh, stack, bottom, number, o, d, t_max, time):
    """`any_hit` in an instance's tree."""
    out_of_line()
    o, d = into(bvh, number, o, d, time)
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, (x[5], y[5], z[5]))
    top = bottom
    child = bvh.instance_root[number]
    while True:
        base = np.uintp(child) * _NODE
        met = bits(_boxes(bvh.node, base, x, y, z, t_max)[0])
        while met != np.uint32(0):
            child = _child(bvh.node, base, lowest_bit(met))
            met = np.uint32(met & np.uint32(met - _BIT))
            if child >= 0:
                store_int(stack, top, child)
                top += np.uintp(1)
            elif bits(_met(_place(bvh.packet, ~child), ~child, o, d, axes, shear, permuted, t_max)[0]) != np.uint32(0):
                return True
        if top == bottom:
            return False
        top -= np.uintp(1)
        child = load_int(stack, top)


@device
def any_hit(bvh, stack, o, d, t_max, time=None, root=_ROOT):
    """Whether anything lies along o + t d with 0 < t < t_max. stack, time, root: as of `closest_hit`."""
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, (x[5], y[5], z[5]))
    top = np.uintp(0)
    child = np.int32(root)
    while True:
        base = np.uintp(child) * _NODE
        met = bits(_boxes(bvh.node, base, x, y, z, t_max)[0])
        while met != np.uint32(0):
            child = _child(bvh.node, base, lowest_bit(met))
            met = np.uint32(met & np.uint32(met - _BIT))
            if child >= 0:
                ask_for(bvh, child, _NEARBY)
                store_int(stack, top, child)
                top += np.uintp(1)
                continue
            leaf = ~child
            if bvh.instances is not None and leaf & INSTANCE:
                if any_in_instance(bvh, stack, top, leaf >> 2, o, d, t_max, time):
                    return True
            elif bits(_met(place_at(bvh, leaf, stack, time), leaf, o, d, axes, shear, permuted, t_max)[0]) != np.uint32(0):
                return True
        if top == np.uintp(0):
            return False
        top -= np.uintp(1)
        child = load_int(stack, top)
