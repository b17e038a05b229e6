"""Segments of round curves: cones with spheres at the joints, as swept by a sphere whose radius changes linearly along them.

Consecutive segments share a point and its radius, so they have the same sphere there and no ray passes between them. Only rays
that enter a segment hit it: a ray that starts inside, such as one that a fibre transmits, leaves it freely. Nor does it hit the
spheres within the fibre: at a joint, a sphere ends at a plane across the axis, beyond which it is inside the next segment
(`reach` in curve_ends.py). At a loose end, where the radius is stored as negative, there is no sphere: curves are open, as are
those of Embree and pbrt, and as long as their file says.

A ray enters a convex body once. If that is not where the cone touches the spheres' common tangents, it is on one of the spheres.
After Quilez, "Rounded cone - intersection" (2016); Reshetov & Luebke, "Phantom Ray-Hair Intersector" (2018) for moving the ray's
origin near the segment, without which float32 is too coarse for thin curves.

A hit's coordinates (u, v) are those of a triangle of the corners a, b and b: u + v is the position along the segment, 0 at a and
1 at b; u - v is the offset h of the ray from the axis, -1 ... 1, in radii. So whatever is interpolated over triangles is
interpolated along curves.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import WIDTH
from renderer.bvh.packet import is_beyond
from renderer.bvh.simd import less, less_equal, load_from, maximum, minimum, select, splat, splat_like, sqrt
from renderer.jit import device, never_inline, subroutine

__all__ = ["curve_hit", "intersect_curve", "intersect_curves"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TINY = np.float32(1e-30)
_PARALLEL = np.float32(1e-6)  # squared sine of the angle between ray and axis below which the nearest points are not computed
_W = np.uintp(WIDTH)


@device
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@device
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@device
def _sphere_entry(a, radius, d, outward, reach, nowhere):
    """Returns (distance at which a ray enters the sphere at an end of a segment, whether the sphere is visible there).

    The distance is `nowhere` if the ray misses it. a: the centre, relative to the ray's origin. radius: negative at a loose end,
    whose sphere is not visible. d: the ray's unit direction. outward: the axis, towards this end. reach: times the radius, how
    far along it the sphere is visible.
    """
    zero = splat_like(radius, _ZERO)
    t = _dot(a, d)
    x, y, z = t * d[0] - a[0], t * d[1] - a[1], t * d[2] - a[2]
    rest = radius * radius - (x * x + y * y + z * z)
    step = sqrt(maximum(rest, zero))
    beyond = outward[0] * x + outward[1] * y + outward[2] * z - step * _dot(outward, d)
    return select(less_equal(zero, rest), t - step, nowhere), less_equal(beyond, reach * radius) & less(zero, radius)


@device
def intersect_curve(a, b, first_radius, last_radius, reach, d):
    """Intersects a ray with one curve segment, or with eight in lanes: (mask, distance, position along it 0 ... 1, offset h).

    The distance may be negative: the caller compares it with the ray's range. a, b: the ends, relative to the ray's origin.
    first_radius: at a; last_radius: at b; both and the reach as in packets. d: the direction of the ray, in the type of the
    lanes; need not be unit.
    """
    zero = splat_like(reach, _ZERO)
    one = splat_like(reach, _ONE)
    nowhere = splat_like(reach, np.float32(np.inf))
    radius, end_radius = maximum(first_radius, zero - first_radius), maximum(last_radius, zero - last_radius)
    # With a unit direction: that of a shadow ray to an infinite distance has a length of 1e18, which leaves float32 little range.
    inverse = one / sqrt(_dot(d, d))
    d = d[0] * inverse, d[1] * inverse, d[2] * inverse
    axis = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    taper = radius - end_radius
    length2 = _dot(axis, axis)
    across = _cross(axis, d)
    sine2 = _dot(across, across)  # of the angle, times the squared length of the axis
    along = _dot(axis, d)
    limit = splat_like(radius, _PARALLEL) * length2
    # The point of the ray nearest to the axis; for nearly parallel rays, that nearest to a.
    base = select(
        less(limit, sine2),
        (zero - _dot(_cross(a, axis), across)) / maximum(sine2, splat_like(radius, _TINY)),
        _dot(a, d),
    )
    o = base * d[0] - a[0], base * d[1] - a[1], base * d[2] - a[2]
    beside = _cross(axis, o)
    m1, m3, m5 = _dot(axis, o), _dot(d, o), _dot(o, o)
    slope2 = taper * taper
    lift = taper * radius
    cone2 = length2 - slope2
    k2 = sine2 - slope2
    k1 = _dot(across, beside) - slope2 * m3 + along * lift
    k0 = _dot(beside, beside) - slope2 * m5 + (m1 + m1) * lift - length2 * radius * radius
    rest = k1 * k1 - k0 * k2
    step = (zero - k1 - sqrt(maximum(rest, zero))) / k2
    y = m1 - lift + step * along
    on_cone = less_equal(zero, rest) & less(zero, y) & less(y, cone2)
    inward = zero - axis[0], zero - axis[1], zero - axis[2]
    first, first_visible = _sphere_entry(a, first_radius, d, inward, reach, nowhere)
    last, last_visible = _sphere_entry(b, last_radius, d, axis, reach, nowhere)
    is_last = less(last, first)
    t = select(on_cone, base + step, select(is_last, last, first))
    s = select(on_cone, y / cone2, select(is_last, one, zero))
    visible = (is_last & last_visible) | (first_visible & less_equal(first, last))
    hit = on_cone | (visible & less(t, nowhere))
    wide = sqrt(sine2) * (radius - s * taper)
    h = (zero - _dot(o, across)) / maximum(wide, splat_like(radius, _TINY))
    return hit, t * inverse, s, minimum(maximum(h, zero - one), one)


@device
def curve_hit(s, h):
    """Returns the coordinates (u, v) of a hit at position s along a segment with offset h."""
    half = splat_like(s, _HALF)
    return (s + h) * half, (s - h) * half


@subroutine
def intersect_curves(base, origin, direction, t_max, after, limit, numbers):
    """Intersects a ray with the curve segments of a packet: (mask8, f32x8 distance, u, v).

    base: the packet's address. after, limit, numbers: as for `intersect_spheres` (packet.py).
    """
    never_inline()
    ox, oy, oz = splat(origin[0]), splat(origin[1]), splat(origin[2])
    d = splat(direction[0]), splat(direction[1]), splat(direction[2])
    a = load_from(base, np.uintp(0)) - ox, load_from(base, _W) - oy, load_from(base, np.uintp(2) * _W) - oz
    b = (
        load_from(base, np.uintp(3) * _W) - ox,
        load_from(base, np.uintp(4) * _W) - oy,
        load_from(base, np.uintp(5) * _W) - oz,
    )
    radii = load_from(base, np.uintp(6) * _W), load_from(base, np.uintp(7) * _W)
    hit, t, s, h = intersect_curve(a, b, *radii, load_from(base, np.uintp(8) * _W), d)
    hit = hit & less(splat(_ZERO), t) & less(t, splat(t_max))
    if after is not None:
        hit = hit & is_beyond(after, limit, t, numbers)
    u, v = curve_hit(s, h)
    return hit, t, u, v
