"""Chooses one of many lights for a shading point, by descending a light tree with importance-weighted children.

Conty Estevez & Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; pbrt 4ed, 12.6.3. The
importances of a node's eight children are computed together, one per lane; renderer/arrays/light_rows.py describes the table rows
of a node. Lights are numbered in tree order, so the number of a light determines its path from the root, and its probability can
be computed for any shading point.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import (
    AXIS,
    CHILD,
    COS_REACH,
    COS_SPREAD,
    END,
    INTENSITY,
    LIGHT_ROWS,
    LIGHT_WIDTH,
    MIRROR,
    NEAR,
    PLACE,
    RADIUS,
    SIN_SPREAD,
)
from renderer.bvh.hit_keys import greater_ints
from renderer.bvh.lane_sums import running_sum, whole_sum
from renderer.bvh.simd import (
    bits,
    extract,
    fma,
    less,
    less_equal,
    load,
    load_int,
    lowest_bit,
    maximum,
    minimum,
    select,
    splat,
    sqrt,
)
from renderer.jit import device, never_inline, subroutine
from renderer.wide.inverse_root import inverse_root

__all__ = ["descend", "sample_light_tree", "tree_probability"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_TINY = np.float32(1e-20)
_HUGE = np.float32(1e37)
_INNER = np.float32(0.3)
_INF = np.float32(np.inf)
_W = np.uintp(LIGHT_WIDTH)
_NODE = np.uintp(LIGHT_ROWS * LIGHT_WIDTH)
_CHILD = np.uintp(CHILD * LIGHT_WIDTH)
_FIRST = np.uint32(0)
_STEP = np.uint32(1)
_LANES = np.uint32(LIGHT_WIDTH - 1)
_LAST = np.uint32(1 << (LIGHT_WIDTH - 1))
_ANY = np.int32(-1)  # complement of light 0


@device
def _row(node, base, number):
    return load(node, base + np.uintp(number) * _W)


@device
def _dot(x, y, z, a, b, c):
    return fma(z, c, fma(y, b, x * a))


@device
def _importances(node, base, p, n):
    """Returns the importances of a node's eight children, f32x8: estimated irradiance at p on a surface with normal n.

    n: in world space; zero for light from all sides. An importance is 0 only if the child's lights contribute nothing.

    The lights of a child are in a sphere of radius r, whose centre is at distance d and at height h above the tangent plane at p.
    Conty Estevez and Kulla divide by d**2, or by r**2 if d is less, and use the cosine of the sphere's highest point, an upper
    bound that overestimates near and large children. This function assumes the lights at about 0.3 r from the centre and weights
    those below the horizon by 0.3, which halves the variance in a room with a thousand lamps. The only root needed is that of
    d**2, which may be approximate.

    If the emitters are directional, their bound of the cosine is used, with sines and cosines multiplied by d.
    """
    zero, one, inner = splat(_ZERO), splat(_ONE), splat(_INNER)
    near, radius = _row(node, base, NEAR), _row(node, base, RADIUS)
    x = fma(splat(p[0]), near, _row(node, base, PLACE))
    y = fma(splat(p[1]), near, _row(node, base, PLACE + 1))
    z = fma(splat(p[2]), near, _row(node, base, PLACE + 2))
    square = _dot(x, y, z, x, y, z)
    far = minimum(maximum(maximum(square, inner * radius * radius), splat(_TINY)), splat(_HUGE))
    inverse = inverse_root(far)

    facing = n[0] != _ZERO or n[1] != _ZERO or n[2] != _ZERO
    height = zero - _dot(x, y, z, splat(n[0]), splat(n[1]), splat(n[2]))
    received = minimum(fma(inner, radius, maximum(height, inner * height)) * inverse, one)
    received = maximum(received, splat(_ZERO if facing else _ONE))
    irradiance = _row(node, base, INTENSITY) * (inverse * inverse) * received

    cos_spread, emitted = _row(node, base, COS_SPREAD), one
    if bits(less(zero - one, cos_spread)) != _FIRST:  # else all emitters are omnidirectional
        among = less_equal(square, radius * radius)
        bound = sqrt(maximum(fma(zero - radius, radius, square), zero))  # `radius` acts as the sine of the angle subtended at p
        along = _dot(x, y, z, _row(node, base, AXIS), _row(node, base, AXIS + 1), _row(node, base, AXIS + 2))
        across = sqrt(maximum(fma(zero - along, along, square), zero))
        along = maximum(along, along * _row(node, base, MIRROR))
        sin_spread = _row(node, base, SIN_SPREAD)
        sine = fma(across, cos_spread, (zero - along) * sin_spread)
        cosine = fma(along, cos_spread, across * sin_spread)
        inside = less_equal(sine, zero) | less_equal(bound, cosine) | among
        emitted = select(inside, far, fma(cosine, bound, sine * radius))
        emitted = select(less(emitted, _row(node, base, COS_REACH) * far), zero, emitted * (inverse * inverse))
    return irradiance * emitted


@device
def descend(node, base, p, n, choice):
    """Descends one level from the node at offset `base`; returns (child, its probability, `choice` rescaled to [0, 1)).

    The child is a node's number, or ~ the number of a light. If no child reaches p, the probability is 0 and the child is ~0,
    which ends the descent. The function has no branches.
    """
    weights = _importances(node, base, p, n)
    sums = running_sum(weights)
    totals = whole_sum(weights)
    at = splat(choice) * totals
    found = bits(less(at, sums))
    none = found == _FIRST
    lane = lowest_bit(found | _LAST)
    weight = extract(weights, lane)
    chance = select(none, _ZERO, weight / extract(totals, _FIRST))
    child = select(none, _ANY, load_int(node, base + _CHILD + np.uintp(lane)))
    before = select(lane > _FIRST, extract(sums, (lane - _STEP) & _LANES), _ZERO)
    return child, chance, min((extract(at, _FIRST) - before) / weight, _BELOW_ONE)


@subroutine
def sample_light_tree(node, p, n, choice):
    """Chooses a light by `choice` in [0, 1); returns (light number, its probability).

    The probability is 0 if the descent reaches a node whose children do not illuminate p.
    """
    never_inline()
    chance = _ONE
    base = np.uintp(0)
    while True:
        child, share, choice = descend(node, base, p, n, choice)
        chance *= share
        if child < 0:
            return np.int64(~child), chance
        base = np.uintp(child) * _NODE


@subroutine
def tree_probability(node, p, n, light):
    """Returns the probability with which `sample_light_tree` chooses `light`, with the same rounding."""
    never_inline()
    chance = _ONE
    base = np.uintp(0)
    while True:
        weights = _importances(node, base, p, n)
        total = extract(whole_sum(weights), _FIRST)
        if not (total > _ZERO and total < _INF):
            return _ZERO
        lane = lowest_bit(bits(greater_ints(_row(node, base, END), np.int32(light))))
        chance *= extract(weights, lane) / total
        child = load_int(node, base + _CHILD + np.uintp(lane))
        if child < 0:
            return chance
        base = np.uintp(child) * _NODE
