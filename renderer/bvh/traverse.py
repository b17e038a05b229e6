"""Traversal of the tree by single rays: closest hit and any hit.

Ray-box slab tests use one fused multiply-add per plane. Its rounding is covered by a slack that each ray adds to its constants
(and the builder to the boxes), so that no box with a hit is missed, including flat boxes and boxes that touch along an edge. A
node's children are visited in order of distance, as long as they are not farther than the closest hit so far: a vector of keys
(distances whose last bits contain the lane) is the whole state of a node, and the next key is computed while the last leaf is
tested. Shadow rays visit children in any order, leaves first.

Hits are ordered by (distance, instance, primitive), those of the world before those of instances: of hits at equal distance the
one with the lower number is the nearest. A ray that passes through a surface continues from the same origin, beyond that hit
(`after`): it misses no surface and hits none twice, however close they are.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.bvh.compressed_traversal import is_occluded_in_compressed, nearest_in_compressed
from renderer.bvh.curves import intersect_curves
from renderer.bvh.hit import FACING, FROM_ORIGIN, NO_PRIMITIVE, SHADOW_REACH, Hit, skip_limit
from renderer.bvh.hit_keys import hit_keys, key_limit, keys_beyond, minimum_key, nearest
from renderer.bvh.instance_space import ray_to_instance
from renderer.bvh.layout import (
    CURVES,
    INSTANCE,
    LEAF_KIND,
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
from renderer.bvh.node_test import ANY_PRIMITIVE, WORLD, intersect_boxes, is_nearer, primitive_of, tie_of
from renderer.bvh.packet import intersect_spheres, intersect_triangles, is_beyond
from renderer.bvh.prefetch import prefetch_child
from renderer.bvh.simd import (
    address,
    bits,
    extract,
    fma,
    load,
    load_int,
    lowest_bit,
    select,
    splat,
    store,
    store_int,
)
from renderer.bvh.slabs import MORE, entry_limit, ray_constants
from renderer.jit import device, never_inline, subroutine
from renderer.prune_absent_features import function_if, where_present

__all__ = [
    "FACING",
    "FROM_ORIGIN",
    "NO_PRIMITIVE",
    "SHADOW_REACH",
    "Hit",
    "any_hit",
    "any_in_instance",
    "camera_root",
    "closest_hit",
    "closest_in_instance",
    "is_instance",
    "new_stack",
    "packet_address_at",
    "shadow_root",
]

_YES, _NO = np.bool_(True), np.bool_(False)
_ROOT = np.int32(0)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_W = np.uintp(WIDTH)
_NODE = np.uintp(NODE_SIZE)
_NEARBY = 8192  # nodes that fit a core's caches: single rays wait little for them, and prefetching takes time
_CHILDREN = np.uintp(ROW_CHILD * WIDTH)
_PRIMITIVES = np.uintp(ROW_PRIMITIVE * WIDTH)
_PACKET = np.uintp(PACKET_SIZE)
_BIT = np.uint32(1)
_LANE = np.int32(WIDTH - 1)  # the bits of a key that hold the lane
_ENTRY = np.uintp(WIDTH + 2)  # words on the stack for a node's pending children: keys, the least key, the node
_BETWEEN = np.uintp(2 * MAX_LEVELS * (WIDTH + 2))  # position on the stack of an interpolated packet


def new_stack() -> npt.NDArray[np.float32]:
    """Allocates the scratch stack of one thread's traversals."""
    # For the world's tree, and an instance's; then for an interpolated packet.
    return np.empty(2 * MAX_LEVELS * int(_ENTRY) + PACKET_SIZE, np.float32)


@device
def _lanes(vector):
    """Returns the three numbers of a vector, each broadcast to all lanes."""
    return splat(vector[0]), splat(vector[1]), splat(vector[2])


@device
def _prepare_ray(o, d, after, facing):
    """Returns a ray's constants for boxes and for packets, and the distance before which boxes need not be visited.

    The constants for boxes are those of `intersect_boxes`. The constants for packets: axes, shear, permuted origin, and the
    margin for `intersect_triangles`. after, facing: as for `closest_hit`.
    """
    ray = ray_constants(o, d, _W)
    slabs = ray.planes, _lanes(ray.inverse), _lanes(ray.near), _lanes(ray.far)
    t_min = _ZERO
    if after is not None:
        t_min = entry_limit(after[0], ray.margin)
    return slabs, (ray.axes, ray.shear, ray.origin, where_present(facing, ray.margin)), t_min


@device
def _packet_address(packet, leaf):
    """Returns the memory address of a leaf's packet."""
    return address(packet, np.uintp(leaf >> 2) * _PACKET)


@subroutine
def _interpolate_packet(packet, leaf, keys, time, stack):
    """Interpolates a leaf's packet at a shutter time and writes it to the stack. keys: the number of the packet's keys."""
    never_inline()
    step, share = step_at(time, keys)
    first = (np.uintp(leaf >> 2) + np.uintp(step)) * _PACKET
    part = splat(share)
    for row in range(PACKET_ROWS - 1):
        offset = np.uintp(row) * _W
        before = load(packet, first + offset)
        store(stack, _BETWEEN + offset, fma(load(packet, first + _PACKET + offset) - before, part, before))


@device
def packet_address_at(bvh, leaf, stack, time):
    """Returns the address of a leaf's packet at a shutter time; a packet with motion keys is interpolated onto the stack."""
    if time is not None and (leaf >> 2) >= bvh.keyed_packets[0]:
        _interpolate_packet(bvh.packet, leaf, bvh.keyed_packets[1], time, stack)
        return address(stack, _BETWEEN)
    return _packet_address(bvh.packet, leaf)


@device
def is_instance(bvh, leaf):
    """Returns a non-zero number, or True, if a leaf is an instance."""
    if bvh.curves is not None:
        return (leaf & LEAF_KIND) == INSTANCE
    return leaf & INSTANCE


@device
def _occludes(bvh, place, leaf, o, d, constants, t_max):
    """Returns True if a shadow ray hits any primitive of a leaf's packet before t_max.

    place: the packet's address. constants: those for packets, from `_prepare_ray`.
    """
    axes, shear, permuted, _ = constants
    if bvh.curves is not None:  # noqa: SIM102 - decided by types
        if (leaf & LEAF_KIND) == CURVES:
            return bits(intersect_curves(place, o, d, t_max, None, None, None)[0]) != np.uint32(0)
    if leaf & SPHERES:
        return bits(intersect_spheres(place, o, d, t_max, None, None, None)[0]) != np.uint32(0)
    return bits(intersect_triangles(place, axes, shear, permuted, None, t_max)[0]) != np.uint32(0)


@device
def _intersect_packet(bvh, place, leaf, o, d, constants, t_max, after, limit, numbers):
    """Intersects a ray with a leaf's packet at address `place`; returns (mask8, distance, u, v, determinant).

    Distance, u and v must still be divided by the determinant.
    """
    axes, shear, permuted, margin = constants
    if bvh.curves is not None:  # noqa: SIM102 - decided by types
        if (leaf & LEAF_KIND) == CURVES:
            hit, t, u, v = intersect_curves(place, o, d, t_max, after, limit, numbers)
            return hit, t, u, v, splat(_ONE)
    if leaf & SPHERES:
        hit, t = intersect_spheres(place, o, d, t_max, after, limit, numbers)
        return hit, t, splat(_ZERO), splat(_ZERO), splat(_ONE)
    return intersect_triangles(place, axes, shear, permuted, margin, t_max)


@device
def _nearest_in_packet(bvh, place, leaf, o, d, constants, found, tie, after, limit):
    """Intersects a ray with a leaf's packet; returns the nearer of `found` and the packet's nearest hit.

    found: (whether there is a hit, distance, primitive, u, v). tie: a hit at the same distance is nearer if its primitive's
    number is lower than this. after: as for `closest_hit`. limit: from `skip_limit`.
    """
    numbers = load(bvh.packet, np.uintp(leaf >> 2) * _PACKET + _PRIMITIVES)
    hit, t, b, c, determinant = _intersect_packet(bvh, place, leaf, o, d, constants, found[1] * MORE, after, limit, numbers)
    if bits(hit) != np.uint32(0):
        inverse = splat(_ONE) / determinant
        t = t * inverse
        if after is not None:
            hit = hit & is_beyond(after, limit, t, numbers)
        distance, lane = nearest(hit, t)  # NaN, if the mask is empty
        primitive = primitive_of(bvh.packet, leaf, lane)
        if is_nearer(distance, primitive, found[1], tie):
            found = _YES, distance, primitive, extract(b * inverse, lane), extract(c * inverse, lane)
    return found


@device
def _intersect_children(node, base, slabs, t_min, best):
    """Returns (sort keys of the children whose boxes the ray enters before distance `best`, the smallest of these keys)."""
    met, distance = intersect_boxes(node, base, *slabs, t_min, best)
    keys = hit_keys(met, distance)
    return keys, minimum_key(keys)


@device
def _child(node, base, lane):
    return load_int(node, base + _CHILDREN + np.uintp(np.uint32(lane)))


@device
def _push(stack, top, base, keys, key):
    """Pushes a node with its pending children on the stack; returns the stack's new top.

    keys, key: the sort keys of these children, and the smallest of them.
    """
    store(stack, top, keys)
    store_int(stack, top + _W, key)
    store_int(stack, top + _W + np.uintp(1), np.int32(base // _NODE))
    return top + _ENTRY


@device
def _pop(stack, top):
    """Pops (node, sort keys of its pending children, the smallest of them) from the stack."""
    key = load_int(stack, top + _W)
    base = np.uintp(np.uint32(load_int(stack, top + _W + np.uintp(1)))) * _NODE
    return base, load(stack, top), key


@subroutine
def closest_in_instance(bvh, stack, bottom, number, o, d, best, holder, time, after, facing):
    """Finds the closest hit nearer than `best` in an instance's tree: (distance, primitive, u, v); NO_PRIMITIVE if there is none.

    holder: the instance of the hit at distance `best`, -1 for the world. after, facing: as for `closest_hit`.
    """
    never_inline()
    number = np.int32(number)
    o, d = ray_to_instance(bvh, number, o, d, time)
    slabs, constants, t_min = _prepare_ray(o, d, after, facing)
    limit = skip_limit(after, number)
    any_tie = number < holder
    found = _NO, best, NO_PRIMITIVE, _ZERO, _ZERO
    top = bottom
    base = np.uintp(bvh.instance_root[number]) * _NODE
    keys, key = _intersect_children(bvh.node, base, slabs, t_min, best)
    while True:
        if key > key_limit(found[1]):
            if top == bottom:
                return found[1], found[2], found[3], found[4]
            top -= _ENTRY
            base, keys, key = _pop(stack, top)
            continue
        child = _child(bvh.node, base, key & _LANE)
        keys = keys_beyond(keys, key)
        key = minimum_key(keys)
        if child >= 0:
            if key <= key_limit(found[1]):
                top = _push(stack, top, base, keys, key)
            base = np.uintp(child) * _NODE
            keys, key = _intersect_children(bvh.node, base, slabs, t_min, found[1])
            continue
        tie = select(any_tie & (not found[0]), ANY_PRIMITIVE, found[2])
        place = _packet_address(bvh.packet, ~child)
        found = _nearest_in_packet(bvh, place, ~child, o, d, constants, found, tie, after, limit)


@device
def camera_root(bvh):
    """Returns the root node for camera rays."""
    if bvh.ray_roots is not None:
        return bvh.ray_roots[0]
    return _ROOT


@device
def shadow_root(bvh):
    """Returns the root node for shadow rays."""
    if bvh.ray_roots is not None:
        return bvh.ray_roots[1]
    return _ROOT


@device
def closest_hit(bvh, stack, o, d, t_max, time=None, root=_ROOT, after=None, facing=FACING):
    """Returns the closest Hit along o + t d with 0 < t < t_max. stack: from `new_stack`.

    time: shutter time, 0 ... 1; None if nothing moves, or for the middle of the shutter. root: the node at which to start. after:
    a hit, (distance, instance, primitive), beyond which hits count; FROM_ORIGIN or None: all hits count. facing: FACING: of
    coincident faces the one that faces the origin is the closest (`intersect_triangles`); None: hits have the distances of
    `any_hit`.
    """
    trace = function_if(bvh.compressed, nearest_in_compressed, _closest_hit)
    return trace(bvh, stack, o, d, t_max, time, root, after, facing)


@device
def _closest_hit(bvh, stack, o, d, t_max, time, root, after, facing):
    slabs, constants, t_min = _prepare_ray(o, d, after, facing)
    limit = skip_limit(after, WORLD)
    found = _NO, t_max, NO_PRIMITIVE, _ZERO, _ZERO
    instance = WORLD
    top = np.uintp(0)
    base = np.uintp(np.uint32(root)) * _NODE
    keys, key = _intersect_children(bvh.node, base, slabs, t_min, t_max)
    while True:
        if key > key_limit(found[1]):
            if top == np.uintp(0):
                break
            top -= _ENTRY
            base, keys, key = _pop(stack, top)
            continue
        child = _child(bvh.node, base, key & _LANE)
        keys = keys_beyond(keys, key)
        key = minimum_key(keys)  # the next key, found while the leaf is tested
        prefetch_child(bvh, _child(bvh.node, base, key & _LANE), _NEARBY)
        if child >= 0:
            if key <= key_limit(found[1]):
                top = _push(stack, top, base, keys, key)
            base = np.uintp(child) * _NODE
            keys, key = _intersect_children(bvh.node, base, slabs, t_min, found[1])
            continue
        leaf = ~child
        if bvh.instances is not None and is_instance(bvh, leaf):
            nearer = closest_in_instance(bvh, stack, top, leaf >> 2, o, d, found[1], instance, time, after, facing)
            if nearer[1] != NO_PRIMITIVE:
                found = _YES, nearer[0], nearer[1], nearer[2], nearer[3]
                instance = np.int32(leaf >> 2)
        else:
            tie = tie_of(instance, found[2])
            start = _NO, found[1], found[2], found[3], found[4]
            place = packet_address_at(bvh, leaf, stack, time)
            found = _nearest_in_packet(bvh, place, leaf, o, d, constants, start, tie, after, limit)
            if found[0]:
                instance = WORLD
    return Hit(found[1], found[2], found[3], found[4], instance, time)


@subroutine
def any_in_instance(bvh, stack, bottom, number, o, d, t_max, time):
    """Returns True if a ray hits anything in an instance's tree; see `any_hit`."""
    never_inline()
    o, d = ray_to_instance(bvh, number, o, d, time)
    slabs, constants, _ = _prepare_ray(o, d, None, None)
    top = bottom
    child = bvh.instance_root[number]
    while True:
        base = np.uintp(child) * _NODE
        met = bits(intersect_boxes(bvh.node, base, *slabs, _ZERO, t_max)[0])
        while met != np.uint32(0):
            child = _child(bvh.node, base, lowest_bit(met))
            met = np.uint32(met & np.uint32(met - _BIT))
            if child >= 0:
                store_int(stack, top, child)
                top += np.uintp(1)
            elif _occludes(bvh, _packet_address(bvh.packet, ~child), ~child, o, d, constants, t_max):
                return True
        if top == bottom:
            return False
        top -= np.uintp(1)
        child = load_int(stack, top)


@device
def any_hit(bvh, stack, o, d, t_max, time=None, root=_ROOT):
    """Returns True if anything is hit along o + t d with 0 < t < t_max. stack, time, root: as for `closest_hit`."""
    trace = function_if(bvh.compressed, is_occluded_in_compressed, _any_hit)
    return trace(bvh, stack, o, d, t_max, time, root)


@device
def _any_hit(bvh, stack, o, d, t_max, time, root):
    slabs, constants, _ = _prepare_ray(o, d, None, None)
    top = np.uintp(0)
    child = np.int32(root)
    while True:
        base = np.uintp(child) * _NODE
        met = bits(intersect_boxes(bvh.node, base, *slabs, _ZERO, t_max)[0])
        while met != np.uint32(0):
            child = _child(bvh.node, base, lowest_bit(met))
            met = np.uint32(met & np.uint32(met - _BIT))
            if child >= 0:
                prefetch_child(bvh, child, _NEARBY)
                store_int(stack, top, child)
                top += np.uintp(1)
                continue
            leaf = ~child
            if bvh.instances is not None and is_instance(bvh, leaf):
                if any_in_instance(bvh, stack, top, leaf >> 2, o, d, t_max, time):
                    return True
            elif _occludes(bvh, packet_address_at(bvh, leaf, stack, time), leaf, o, d, constants, t_max):
                return True
        if top == np.uintp(0):
            return False
        top -= np.uintp(1)
        child = load_int(stack, top)
