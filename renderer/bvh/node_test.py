"""The tests that all traversals share: the intersection of a ray with a node's boxes, and the comparison of two hits."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import PACKET_SIZE, ROW_PRIMITIVE, WIDTH
from renderer.bvh.simd import fma, less_equal, load, load_int, maximum, minimum, select, splat
from renderer.jit import device

__all__ = ["ANY_PRIMITIVE", "WORLD", "intersect_boxes", "is_nearer", "primitive_of", "tie_of"]

WORLD = np.int32(-1)  # in place of an instance's number: the hit is not in an instance
ANY_PRIMITIVE = np.int32(2**31 - 1)
_W = np.uintp(WIDTH)
_PACKET = np.uintp(PACKET_SIZE)
_PRIMITIVES = np.uintp(ROW_PRIMITIVE * WIDTH)


@device
def intersect_boxes(node, base, planes, inverse, near, far, t_min, t_max):
    """Intersects a ray with a node's eight boxes, between t_min and t_max; returns (mask8 of boxes hit, f32x8 entry distances).

    base: flat index of the node's first element. The ray's constants for each axis: planes: offset of the row of the planes that
    the ray enters by (those that it leaves by are WIDTH elements away); inverse, near, far: f32x8 each, such that a near plane at
    x is hit at distance x * inverse + near.
    """
    x, y, z = planes
    x_near, x_far = fma(load(node, base + x), inverse[0], near[0]), fma(load(node, base + (x ^ _W)), inverse[0], far[0])
    y_near, y_far = fma(load(node, base + y), inverse[1], near[1]), fma(load(node, base + (y ^ _W)), inverse[1], far[1])
    z_near, z_far = fma(load(node, base + z), inverse[2], near[2]), fma(load(node, base + (z ^ _W)), inverse[2], far[2])
    # NaN propagates, from the second operand of `maximum` and `minimum`, so that a ray with NaN hits nothing: else it would visit
    # lanes without a child endlessly.
    entered = maximum(maximum(x_near, y_near), maximum(splat(t_min), z_near))
    left = minimum(minimum(x_far, y_far), minimum(splat(t_max), z_far))
    return less_equal(entered, left), entered


@device
def primitive_of(packet, leaf, lane):
    """Returns the number of the primitive in one lane of a leaf's packet."""
    return load_int(packet, np.uintp(leaf >> 2) * _PACKET + _PRIMITIVES + np.uintp(lane))


@device
def tie_of(instance, primitive):
    """Returns the `tie` of a hit for `is_nearer`: at equal distance, world primitives with a lower number precede the hit.

    instance, primitive: those of the hit. Any primitive of the world precedes a hit in an instance.
    """
    return select(instance > WORLD, ANY_PRIMITIVE, primitive)


@device
def is_nearer(distance, primitive, best, tie):
    """Returns True if a hit at `distance` precedes the current closest hit, which is at distance `best`.

    Hits are ordered by (distance, instance, primitive). tie: the result of `tie_of` for the current hit. Returns False if
    `distance` is NaN.
    """
    return (distance < best) | ((distance == best) & (primitive < tie))
