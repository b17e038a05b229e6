"""Rays through the tree: the closest hit, and whether there is any.

The boxes' slabs are met by one fused multiply-add a plane. Its rounding is made good by a slack that each ray adds to its
own constants (and that the builder adds to the boxes), so that no box is missed that holds a hit: flat boxes and boxes that
touch along an edge included. The nearest child is visited first; the others wait on the stack, unsorted, with their
distances, and are dropped when something nearer has been hit since. Sorting them costs more in wrong branches than it saves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import (
    INSTANCE,
    NODE_SIZE,
    PACKET_SIZE,
    ROW_CHILD,
    ROW_PRIMITIVE,
    SPHERES,
    STACK_SIZE,
    WIDTH,
)
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
    splat,
    store_int,
)
from renderer.jit import device, out_of_line, subroutine

__all__ = ["NO_PRIMITIVE", "Hit", "any_hit", "closest_hit", "new_stack", "to_local"]

NO_PRIMITIVE = np.int32(-1)
_WORLD = np.int32(-1)
_NOWHERE = np.int32(-(2**31))  # where a child's number is expected: neither a node nor a leaf
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-18)
_SLACK = np.float32(4 * 2.0**-24)
_W = np.uintp(WIDTH)
_NODE = np.uintp(NODE_SIZE)
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_PRIMITIVES = np.uintp(ROW_PRIMITIVE * WIDTH)
_PACKET = np.uintp(PACKET_SIZE)
_BIT = np.uint32(1)


class Hit(NamedTuple):
    """What a ray meets first."""

    t: float  # along the ray, in lengths of its direction
    primitive: int  # triangles first, then spheres; NO_PRIMITIVE where nothing is met
    u: float  # barycentric coordinates of the triangle's corners b and c; 0 for spheres
    v: float
    instance: int  # whose space the primitive is in; -1 for the world's


def new_stack() -> npt.NDArray[np.float32]:
    """The scratch space of one thread's traversals, for the kernel that it calls."""
    return np.empty(4 * STACK_SIZE, np.float32)  # a distance and a child each, for both levels


@device
def _slab(o, d):
    """What a ray needs of one axis: (f32x8 of 1/d, of the near plane's constant, of the far plane's, the near row's offset,
    the far row's, and 1/d once more).

    A component near zero is taken as +-1e-18: 0 * inf would be NaN, and turn a ray into a walk of the whole tree.
    """
    if abs(d) < _TINY:
        d = -_TINY if d < _ZERO else _TINY
    inverse = _ONE / d
    constant = -o * inverse
    slack = abs(constant) * _SLACK
    near = np.uintp(0) if inverse > _ZERO else _W
    return splat(inverse), splat(constant - slack), splat(constant + slack), near, _W - near, inverse


@device
def _boxes(node, base, x, y, z, t_max):
    """The ray against a node's eight boxes: (bits of those met, f32x8 distances)."""
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
    return bits(less_equal(near, far)), near


@device
def _axes(o, d, x, y, z):
    """The watertight test's frame, axes permuted so that the last is the direction's largest: row offsets, shear, origin.

    x, y, z: from `_slab`. Choices of values, not branches: which axis it is cannot be predicted.
    """
    ax, ay, az = abs(d[0]), abs(d[1]), abs(d[2])
    first = (ax > ay) & (ax > az)
    second = (ay > az) & (not first)
    dx = d[1] if first else (d[2] if second else d[0])
    dy = d[2] if first else (d[0] if second else d[1])
    ox = o[1] if first else (o[2] if second else o[0])
    oy = o[2] if first else (o[0] if second else o[1])
    oz = o[0] if first else (o[1] if second else o[2])
    zero = np.uintp(0)
    two = _W + _W
    kx = _W if first else (two if second else zero)
    ky = two if first else (zero if second else _W)
    kz = zero if first else (_W if second else two)
    inverse = x[5] if first else (y[5] if second else z[5])
    return (kx, ky, kz), (dx * inverse, dy * inverse, inverse), (ox, oy, oz)


@device
def _descend(node, stack, top, child, x, y, z, best):
    """From a node down to the nearest leaf: (it, or _NOWHERE; the stack's new top). The other children go on the stack."""
    while child >= 0:
        base = np.uintp(child) * _NODE
        met, distance = _boxes(node, base, x, y, z, best)
        if met == np.uint32(0):
            return _NOWHERE, top
        lane = lowest_bit(met)
        child = load_int(node, base + _CHILDREN + np.uintp(lane))
        met = np.uint32(met & np.uint32(met - _BIT))
        if met == np.uint32(0):
            continue
        nearest = extract(distance, lane)
        while met != np.uint32(0):
            lane = lowest_bit(met)
            met = np.uint32(met & np.uint32(met - _BIT))
            further = extract(distance, lane)
            other = load_int(node, base + _CHILDREN + np.uintp(lane))
            closer = further < nearest
            stack[np.uintp(2) * top] = nearest if closer else further
            store_int(stack, np.uintp(2) * top + np.uintp(1), child if closer else other)
            nearest = further if closer else nearest
            child = other if closer else child
            top += np.uintp(1)
    return child, top


@device
def _meet(packet, leaf, o, d, axes, shear, permuted, best, primitive, u, v):
    """What a leaf's packet makes of the nearest hit so far: (distance, primitive, u, v)."""
    number = np.uintp(leaf >> 2) * _PACKET
    leaf_base = address(packet, number)
    if leaf & SPHERES:
        met, t = meet_spheres(leaf_base, o, d, best)
        b = c = splat(_ZERO)
        determinant = splat(_ONE)
    else:
        met, t, b, c, determinant = meet_triangles(leaf_base, axes, shear, permuted, best)
    while met != np.uint32(0):
        lane = lowest_bit(met)
        met = np.uint32(met & np.uint32(met - _BIT))
        inverse = _ONE / extract(determinant, lane)
        distance = extract(t, lane) * inverse
        if distance < best:
            best = distance
            u = extract(b, lane) * inverse
            v = extract(c, lane) * inverse
            primitive = load_int(packet, number + _PRIMITIVES + np.uintp(lane))
    return best, primitive, u, v


@device
def to_local(transform, number, o, d):
    """A ray in an instance's space. Its direction keeps the transform's scale, so that t stays the world's.

    In double precision, rounded once: then a ray that starts beside the instance's surface is off it by no more than it
    would be beside the same triangles in the world.
    """
    ox, oy, oz = np.float64(o[0]), np.float64(o[1]), np.float64(o[2])
    dx, dy, dz = np.float64(d[0]), np.float64(d[1]), np.float64(d[2])
    m = transform[number]
    return (
        (
            np.float32(m[0, 0] * ox + m[0, 1] * oy + m[0, 2] * oz + m[0, 3]),
            np.float32(m[1, 0] * ox + m[1, 1] * oy + m[1, 2] * oz + m[1, 3]),
            np.float32(m[2, 0] * ox + m[2, 1] * oy + m[2, 2] * oz + m[2, 3]),
        ),
        (
            np.float32(m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz),
            np.float32(m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz),
            np.float32(m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz),
        ),
    )


@subroutine
def _closest_in_instance(bvh, stack, bottom, number, o, d, best):
    """The nearest hit nearer than `best` in an instance's tree: (distance, primitive, u, v); NO_PRIMITIVE where there is none."""
    out_of_line()
    o, d = to_local(bvh.to_local, number, o, d)
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, x, y, z)
    primitive, u, v = NO_PRIMITIVE, _ZERO, _ZERO
    top = bottom + np.uintp(1)
    stack[np.uintp(2) * bottom] = _ZERO
    store_int(stack, np.uintp(2) * bottom + np.uintp(1), bvh.instance_root[number])
    while top > bottom:
        top -= np.uintp(1)
        if stack[np.uintp(2) * top] > best:
            continue
        child = load_int(stack, np.uintp(2) * top + np.uintp(1))
        child, top = _descend(bvh.node, stack, top, child, x, y, z, best)
        if child != _NOWHERE:
            best, primitive, u, v = _meet(bvh.packet, ~child, o, d, axes, shear, permuted, best, primitive, u, v)
    return best, primitive, u, v


@device
def closest_hit(bvh, stack, o, d, t_max):
    """The nearest primitive along o + t d with 0 < t < t_max: a Hit. stack: from `new_stack`."""
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, x, y, z)
    best, primitive, u, v = t_max, NO_PRIMITIVE, _ZERO, _ZERO
    instance = _WORLD
    top = np.uintp(1)
    stack[0] = _ZERO
    store_int(stack, np.uintp(1), np.int32(0))
    while top > np.uintp(0):
        top -= np.uintp(1)
        if stack[np.uintp(2) * top] > best:
            continue
        child = load_int(stack, np.uintp(2) * top + np.uintp(1))
        child, top = _descend(bvh.node, stack, top, child, x, y, z, best)
        if child == _NOWHERE:
            continue
        leaf = ~child
        if leaf & INSTANCE:
            found = _closest_in_instance(bvh, stack, top, leaf >> 2, o, d, best)
            if found[1] != NO_PRIMITIVE:
                best, primitive, u, v = found
                instance = np.int32(leaf >> 2)
        else:
            nearer = best
            best, primitive, u, v = _meet(bvh.packet, leaf, o, d, axes, shear, permuted, best, primitive, u, v)
            if best < nearer:
                instance = _WORLD
    return Hit(best, primitive, u, v, instance)


@device
def _meets(packet, leaf, o, d, axes, shear, permuted, t_max):
    """Whether a leaf's packet is met."""
    leaf_base = address(packet, np.uintp(leaf >> 2) * _PACKET)
    if leaf & SPHERES:
        met, _ = meet_spheres(leaf_base, o, d, t_max)
    else:
        met, _, _, _, _ = meet_triangles(leaf_base, axes, shear, permuted, t_max)
    return met != np.uint32(0)


@device
def _open_all(node, stack, top, child, x, y, z, t_max):
    """Puts all children of a node that the ray meets on the stack: its new top."""
    base = np.uintp(child) * _NODE
    met, _ = _boxes(node, base, x, y, z, t_max)
    while met != np.uint32(0):
        store_int(stack, top, load_int(node, base + _CHILDREN + np.uintp(lowest_bit(met))))
        top += np.uintp(1)
        met = np.uint32(met & np.uint32(met - _BIT))
    return top


@subroutine
def _any_in_instance(bvh, stack, bottom, number, o, d, t_max):
    """`any_hit` in an instance's tree."""
    out_of_line()
    o, d = to_local(bvh.to_local, number, o, d)
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, x, y, z)
    top = bottom + np.uintp(1)
    store_int(stack, bottom, bvh.instance_root[number])
    while top > bottom:
        top -= np.uintp(1)
        child = load_int(stack, top)
        if child >= 0:
            top = _open_all(bvh.node, stack, top, child, x, y, z, t_max)
        elif _meets(bvh.packet, ~child, o, d, axes, shear, permuted, t_max):
            return True
    return False


@device
def any_hit(bvh, stack, o, d, t_max):
    """Whether anything lies along o + t d with 0 < t < t_max. stack: from `new_stack`."""
    x = _slab(o[0], d[0])
    y = _slab(o[1], d[1])
    z = _slab(o[2], d[2])
    axes, shear, permuted = _axes(o, d, x, y, z)
    top = np.uintp(1)
    store_int(stack, np.uintp(0), np.int32(0))
    while top > np.uintp(0):
        top -= np.uintp(1)
        child = load_int(stack, top)
        if child >= 0:
            top = _open_all(bvh.node, stack, top, child, x, y, z, t_max)
            continue
        leaf = ~child
        if leaf & INSTANCE:
            if _any_in_instance(bvh, stack, top, leaf >> 2, o, d, t_max):
                return True
        elif _meets(bvh.packet, leaf, o, d, axes, shear, permuted, t_max):
            return True
    return False
