"""Traversal of a compressed tree by single rays: closest hit and any hit, for graphics cards.

A node's children that a ray enters are two groups, inner nodes and leaves: the index of the first child, and a mask of the slots
not yet visited, in the order of the ray's octant. One loop follows a ray through the world's tree and through instances; the
stack then contains the world's groups below those of the instance.

Hits are those of renderer/bvh/traverse.py to the bit: boxes contain that tree's boxes, primitives are tested by the same
formulas, and hits are ordered by (distance, instance, primitive), whatever the order of the visits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.compressed_tree import KEYED, LEAF_NUMBERS, NODE_WORDS
from renderer.bvh.curves import curve_hit, intersect_curve
from renderer.bvh.hit import NO_PRIMITIVE, Hit, skip_limit
from renderer.bvh.instance_space import ray_to_instance
from renderer.bvh.layout import CURVES, INSTANCE, LEAF_KIND, SPHERES
from renderer.bvh.motion import step_at
from renderer.bvh.node_test import WORLD
from renderer.bvh.packet import intersect_corners, sphere_roots
from renderer.bvh.simd import fma, less, load_int, maximum, minimum, row_at, select, store_int
from renderer.bvh.slabs import MORE, entry_limit, ray_constants
from renderer.jit import device, never_inline, subroutine
from renderer.prune_absent_features import where_present

__all__ = ["is_occluded_in_compressed", "nearest_in_compressed"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_AXIS = np.int64(1)  # `width` of `ray_constants`: axes are numbered 0, 1, 2
_YES = np.bool_(True)
_SLACK = np.float32(8 * 2.0**-24)  # of a plane's distance, for the rounding of a grid's constants and of the plane's
_STEPS = np.float32(256.0)
_NODE = np.uintp(NODE_WORDS)
_LEAF = np.uintp(LEAF_NUMBERS)
_B, _C, _KIND, _PRIMITIVE, _KEYS = np.uintp(4), np.uintp(8), np.uintp(7), np.uintp(3), np.uintp(11)
_PENDING = np.uint32(0xFF)  # of a group: slots not yet visited, in the ray's order; above them its mask of all slots
_LEAVES = np.uint32(1 << 16)  # marks a group of leaves on the stack
_NOTHING = np.uint32(0)
_BIT = np.uint32(1)
_ENTRY = np.uintp(2)
_EMPTY = np.uintp(0)
_I32 = ir.IntType(32)


@intrinsic
def _load_four_words(typingctx, array, index):
    """Loads the bits of four numbers from an array's flat element `index`, at an address aligned to 16 bytes. Unchecked."""

    def codegen(context, builder, sig, args):
        value = builder.load(row_at(context, builder, sig.args[0], *args, ir.VectorType(_I32, 4)))
        value.align = 16
        parts = [builder.extract_element(value, _I32(k)) for k in range(4)]
        return context.make_tuple(builder, sig.return_type, parts)

    return types.UniTuple(types.uint32, 4)(array, types.uintp), codegen


@intrinsic
def _as_float(typingctx, word):
    """Returns the float32 with the bits of a uint32."""
    return types.float32(types.uint32), lambda context, builder, sig, args: builder.bitcast(args[0], ir.FloatType())


@intrinsic
def _popcount(typingctx, word):
    """Returns the number of set bits of a uint32."""

    def codegen(context, builder, sig, args):
        return builder.ctpop(args[0])

    return types.uint32(types.uint32), codegen


@intrinsic
def _highest_bit(typingctx, word):
    """Returns the index of the highest set bit of a uint32 that is not zero."""

    def codegen(context, builder, sig, args):
        return builder.sub(_I32(31), builder.ctlz(args[0], ir.Constant(ir.IntType(1), 1)))

    return types.uint32(types.uint32), codegen


class _Ray(NamedTuple):
    """A ray in the space of the tree that it traverses, and its constants."""

    o: Any
    d: Any
    inverse: Any  # for planes of boxes, as are `near` and `far` (RayConstants)
    near: Any
    far: Any
    axes: Any  # for corners of triangles, as are `shear`, `origin` and `margin`; numbers of axes
    shear: Any
    origin: Any
    margin: Any
    octant: Any  # a mask of the axes along which the ray ascends: slots are visited in the descending order of slot ^ octant
    t_min: Any  # boxes that end before this distance need not be visited
    limit: Any  # from `skip_limit`


@device
def _prepare_ray(o, d, after, number):
    """Returns the _Ray for a ray in world space (number -1) or in the space of instance `number`. after: as for `closest_hit`."""
    ray = ray_constants(o, d, _AXIS)
    axes = np.int32(ray.axes[0]), np.int32(ray.axes[1]), np.int32(ray.axes[2])
    x = select(ray.inverse[0] > _ZERO, np.uint32(1), _NOTHING)
    y = select(ray.inverse[1] > _ZERO, np.uint32(2), _NOTHING)
    z = select(ray.inverse[2] > _ZERO, np.uint32(4), _NOTHING)
    t_min = _ZERO
    if after is not None:
        t_min = entry_limit(after[0], ray.margin)
    octant, limit = np.uint32(x | y | z), skip_limit(after, number)
    return _Ray(o, d, ray.inverse, ray.near, ray.far, axes, ray.shear, ray.origin, ray.margin, octant, t_min, limit)


@device
def _permute_mask(mask, octant):
    """Moves bit k of a mask of eight slots to bit k ^ octant."""
    if octant & np.uint32(1):
        mask = np.uint32(((mask & np.uint32(0x55)) << _BIT) | ((mask & np.uint32(0xAA)) >> _BIT))
    if octant & np.uint32(2):
        mask = np.uint32(((mask & np.uint32(0x33)) << np.uint32(2)) | ((mask & np.uint32(0xCC)) >> np.uint32(2)))
    if octant & np.uint32(4):
        mask = np.uint32(((mask & np.uint32(0x0F)) << np.uint32(4)) | ((mask & np.uint32(0xF0)) >> np.uint32(4)))
    return mask


@device
def _byte(word, k):
    return np.uint32(np.uint32(word >> np.uint32(8 * k)) & np.uint32(255))


@device
def _grid_axis(origin, exponent, inverse, near, far):
    """Returns a ray's constants for a node's grid along one axis: (distance of one grid step, near offset, far offset).

    The ray hits the plane at grid step k at distance k * step + offset. The near offset, for planes by which the ray enters a
    box, is reduced to allow for all rounding; the far offset is increased.
    """
    step = _as_float(np.uint32(exponent << np.uint32(23))) * inverse
    first, last = fma(origin, inverse, near), fma(origin, inverse, far)
    slack = (max(abs(first), abs(last)) + _STEPS * abs(step)) * _SLACK
    return step, first - slack, last + slack


@device
def _intersect_four_boxes(x, y, z, near, far, t_min, best):
    """Tests four of a node's boxes; returns a mask with one bit for each box that the ray enters.

    x, y, z: the ray's constants from `_grid_axis`. near, far: for each axis a word with one byte per box, the grid step of the
    plane by which the ray enters or leaves the box. t_min, best: the range of distances.
    """
    mask = _NOTHING
    for k in range(4):
        x_near, x_far = fma(np.float32(_byte(near[0], k)), x[0], x[1]), fma(np.float32(_byte(far[0], k)), x[0], x[2])
        y_near, y_far = fma(np.float32(_byte(near[1], k)), y[0], y[1]), fma(np.float32(_byte(far[1], k)), y[0], y[2])
        z_near, z_far = fma(np.float32(_byte(near[2], k)), z[0], z[1]), fma(np.float32(_byte(far[2], k)), z[0], z[2])
        first = maximum(maximum(x_near, y_near), maximum(t_min, z_near))
        last = minimum(minimum(x_far, y_far), minimum(best, z_far))
        mask |= select(first <= last, np.uint32(_BIT << np.uint32(k)), _NOTHING)
    return np.uint32(mask)


@device
def _intersect_node(node, at, ray, best):
    """Returns the children of a node that a ray enters before distance `best`, as two groups with the index of their first child.

    Returns (inner group, index of the first inner child, leaf group, index of the first leaf). A group is a word: its lowest
    byte is a mask of the slots to visit, in the order of the ray's octant; the next byte, of all slots of that kind.
    """
    base, octant = np.uintp(at) * _NODE, ray.octant
    a, b = _load_four_words(node, base), _load_four_words(node, base + np.uintp(4))
    c, d, e = (
        _load_four_words(node, base + np.uintp(8)),
        _load_four_words(node, base + np.uintp(12)),
        _load_four_words(node, base + np.uintp(16)),
    )
    x = _grid_axis(_as_float(a[0]), _byte(a[3], 0), ray.inverse[0], ray.near[0], ray.far[0])
    y = _grid_axis(_as_float(a[1]), _byte(a[3], 1), ray.inverse[1], ray.near[1], ray.far[1])
    z = _grid_axis(_as_float(a[2]), _byte(a[3], 2), ray.inverse[2], ray.near[2], ray.far[2])
    up = octant & np.uint32(1) != _NOTHING, octant & np.uint32(2) != _NOTHING, octant & np.uint32(4) != _NOTHING
    low = (
        (select(up[0], c[0], d[2]), select(up[1], c[2], e[0]), select(up[2], d[0], e[2])),
        (select(up[0], d[2], c[0]), select(up[1], e[0], c[2]), select(up[2], e[2], d[0])),
    )
    high = (
        (select(up[0], c[1], d[3]), select(up[1], c[3], e[1]), select(up[2], d[1], e[3])),
        (select(up[0], d[3], c[1]), select(up[1], e[1], c[3]), select(up[2], e[3], d[1])),
    )
    upper = _intersect_four_boxes(x, y, z, high[0], high[1], ray.t_min, best)
    entered = np.uint32(_intersect_four_boxes(x, y, z, low[0], low[1], ray.t_min, best) | np.uint32(upper << np.uint32(4)))
    inner_mask, leaf_mask = _byte(a[3], 3), np.uint32(b[2] & _PENDING)
    inner = np.uint32(_permute_mask(np.uint32(entered & inner_mask), octant) | np.uint32(inner_mask << np.uint32(8)))
    leaves = np.uint32(_permute_mask(np.uint32(entered & leaf_mask), octant) | np.uint32(leaf_mask << np.uint32(8)))
    return inner, b[0], leaves, b[1]


@device
def _pop_child(group, first, octant):
    """Removes the next child from a group; returns the group and the child's index."""
    place = _highest_bit(np.uint32(group & _PENDING))
    slot = np.uint32(place ^ octant)
    before = np.uint32(np.uint32(group >> np.uint32(8)) & np.uint32(np.uint32(_BIT << slot) - _BIT))
    return np.uint32(group ^ np.uint32(_BIT << place)), np.uint32(first + _popcount(before))


@device
def _interpolate_three(leaf, base, next_base, share, row):
    """Returns three numbers of a leaf, interpolated linearly between two motion keys.

    base, next_base: first elements of the leaf's rows for the two keys. share: the weight of the later key. row: offset of the
    three numbers in a leaf's row.
    """
    a, b = _load_four_words(leaf, base + row), _load_four_words(leaf, next_base + row)
    x, y, z = _as_float(a[0]), _as_float(a[1]), _as_float(a[2])
    return (
        fma(_as_float(b[0]) - x, share, x),
        fma(_as_float(b[1]) - y, share, y),
        fma(_as_float(b[2]) - z, share, z),
    )


@device
def _corners(bvh, base, kind, time):
    """Returns the three corners in a row of leaves (spheres: centre, and radius), at a shutter time. base: its first element."""
    leaf = bvh.compressed.leaf
    p, q, r = _load_four_words(leaf, base), _load_four_words(leaf, base + _B), _load_four_words(leaf, base + _C)
    a = _as_float(p[0]), _as_float(p[1]), _as_float(p[2])
    b = _as_float(q[0]), _as_float(q[1]), _as_float(q[2])
    c = _as_float(r[0]), _as_float(r[1]), _as_float(r[2])
    if time is not None and bvh.keyed_packets is not None:  # noqa: SIM102 - the outer one is decided by types
        if kind & KEYED:
            step, share = step_at(time, bvh.keyed_packets[1])
            before = (np.uintp(r[3]) + np.uintp(step)) * _LEAF
            after = before + _LEAF
            a = _interpolate_three(leaf, before, after, share, _EMPTY)
            b = _interpolate_three(leaf, before, after, share, _B)
            c = _interpolate_three(leaf, before, after, share, _C)
    return a, b, c


@device
def _relative_to_origin(corner, o, axes):
    """Returns a corner relative to a ray's origin, in the order of the ray's axes. o: the origin in that order."""
    x, y, z = corner
    kx, ky, kz = axes
    one, two = np.int32(1), np.int32(2)
    return (
        select(kx == one, y, select(kx == two, z, x)) - o[0],
        select(ky == one, y, select(ky == two, z, x)) - o[1],
        select(kz == one, y, select(kz == two, z, x)) - o[2],
    )


@device
def _is_beyond(after, limit, t, number):
    """Returns True for hits beyond `after`; see `is_beyond` in renderer/bvh/packet.py."""
    return (after[0] < t) | ((after[0] <= t) & (number > limit))


@device
def _intersect_sphere(a, radius, o, d, number, t_max, after, limit):
    """Intersects a ray with a sphere; returns (whether there is a hit, its distance)."""
    f = np.float64(o[0]) - np.float64(a[0]), np.float64(o[1]) - np.float64(a[1]), np.float64(o[2]) - np.float64(a[2])
    direction = np.float64(d[0]), np.float64(d[1]), np.float64(d[2])
    near, far = sphere_roots(f, direction, np.float64(radius), 0.0)
    if after is not None:
        first, last = np.float32(near), np.float32(far)
        t = select(_is_beyond(after, limit, first, number), first, last)
        return _is_beyond(after, limit, t, number) & less(t, t_max), t
    t = np.float32(select(less(0.0, near), near, far))
    return less(_ZERO, t) & less(t, t_max), t


@device
def _intersect_curve(a, b, rest, o, d, number, t_max, after, limit):
    """Intersects a ray with a curve segment; returns (whether there is a hit, its distance, u, v)."""
    first, last = (a[0] - o[0], a[1] - o[1], a[2] - o[2]), (b[0] - o[0], b[1] - o[1], b[2] - o[2])
    hit, t, s, h = intersect_curve(first, last, *rest, d)
    u, v = curve_hit(s, h)
    hit = hit & less(_ZERO, t) & less(t, t_max)
    if after is not None:
        hit = hit & _is_beyond(after, limit, t, number)
    return hit, t, u, v


@subroutine
def _trace(bvh, stack, o, d, t_max, time, root, after, facing, shadow):
    """Returns the closest Hit; with `shadow`, not None, any hit, without its distance and coordinates."""
    never_inline()
    node, leaf = bvh.compressed.node, bvh.compressed.leaf
    ray, instance = _prepare_ray(o, d, after, WORLD), WORLD
    t, primitive, u, v, holder = t_max, NO_PRIMITIVE, _ZERO, _ZERO, WORLD
    top, bottom = _EMPTY, _EMPTY
    group, first = _NOTHING, _NOTHING
    at = np.uint32(root)
    while True:
        inner, inner_first, leaves, leaf_first = _intersect_node(node, at, ray, t)
        if inner & _PENDING:
            if group & _PENDING:
                store_int(stack, top, np.int32(first))
                store_int(stack, top + np.uintp(1), np.int32(group))
                top += _ENTRY
            group, first = inner, inner_first
        while True:  # leaves, until the next node to visit
            if leaves & _PENDING:
                leaves, row = _pop_child(leaves, leaf_first, ray.octant)
                base = np.uintp(row) * _LEAF
                number = load_int(leaf, base + _PRIMITIVE)
                kind = load_int(leaf, base + _KIND)
                if bvh.instances is not None:  # noqa: SIM102 - decided by types
                    if kind == INSTANCE:
                        if group & _PENDING:
                            store_int(stack, top, np.int32(first))
                            store_int(stack, top + np.uintp(1), np.int32(group))
                            top += _ENTRY
                            group = _NOTHING
                        if leaves & _PENDING:
                            store_int(stack, top, np.int32(leaf_first))
                            store_int(stack, top + np.uintp(1), np.int32(leaves | _LEAVES))
                            top += _ENTRY
                        bottom, instance = top, number
                        local_o, local_d = ray_to_instance(bvh, number, o, d, time)
                        ray = _prepare_ray(local_o, local_d, after, number)
                        at = np.uint32(bvh.instance_root[number])
                        break
                a, b, c = _corners(bvh, base, kind, time)
                reach = t
                if shadow is None:
                    reach = t * MORE
                if bvh.curves is not None and (kind & LEAF_KIND) == CURVES:
                    hit, distance, beta, gamma = _intersect_curve(a, b, c, ray.o, ray.d, number, reach, after, ray.limit)
                    determinant = _ONE
                elif kind & SPHERES:
                    hit, distance = _intersect_sphere(a, b[0], ray.o, ray.d, number, reach, after, ray.limit)
                    beta, gamma, determinant = _ZERO, _ZERO, _ONE
                else:
                    hit, distance, beta, gamma, determinant = intersect_corners(
                        _relative_to_origin(a, ray.origin, ray.axes),
                        _relative_to_origin(b, ray.origin, ray.axes),
                        _relative_to_origin(c, ray.origin, ray.axes),
                        ray.shear,
                        where_present(facing, ray.margin),
                        reach,
                    )
                if hit:
                    if shadow is not None:
                        return Hit(t, number, u, v, instance, time)
                    inverse = _ONE / determinant
                    distance = distance * inverse
                    is_new = _YES
                    if after is not None:
                        is_new = _is_beyond(after, ray.limit, distance, number)
                    is_first = (instance < holder) | ((instance == holder) & (number < primitive))
                    if is_new & ((distance < t) | ((distance == t) & is_first)):
                        t, primitive, u, v, holder = distance, number, beta * inverse, gamma * inverse, instance
                continue
            if group & _PENDING:
                group, at = _pop_child(group, first, ray.octant)
                break
            if top > bottom:
                top -= _ENTRY
                popped_first, popped = np.uint32(load_int(stack, top)), np.uint32(load_int(stack, top + np.uintp(1)))
                if popped & _LEAVES:
                    leaves, leaf_first = popped, popped_first
                else:
                    group, first = popped, popped_first
                continue
            if instance == WORLD:
                return Hit(t, primitive, u, v, holder, time)
            ray, bottom, instance = _prepare_ray(o, d, after, WORLD), _EMPTY, WORLD


@device
def nearest_in_compressed(bvh, stack, o, d, t_max, time, root, after, facing):
    """Returns the closest Hit in a compressed tree. Arguments: as for `closest_hit` (renderer/bvh/traverse.py)."""
    return _trace(bvh, stack, o, d, t_max, time, root, after, facing, None)


@device
def is_occluded_in_compressed(bvh, stack, o, d, t_max, time, root):
    """Returns True if a ray hits anything in a compressed tree. Arguments: as for `any_hit` (renderer/bvh/traverse.py)."""
    return _trace(bvh, stack, o, d, t_max, time, root, None, None, _YES).primitive != NO_PRIMITIVE
