"""Intersects one ray with eight triangles, or with eight spheres, at once."""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.hit_keys import greater_ints
from renderer.bvh.layout import WIDTH
from renderer.bvh.simd import (
    flip,
    fma,
    less,
    less_equal,
    load_from,
    maximum,
    minimum,
    product,
    select,
    splat,
    splat_like,
    sqrt,
    to_double,
    to_single,
)
from renderer.jit import device, never_inline, subroutine

__all__ = ["intersect_corners", "intersect_spheres", "intersect_triangles", "is_beyond", "sphere_roots"]

_ZERO = np.float32(0.0)
# Relative distance by which front faces are nearer and back faces farther: 16 ulps, above the rounding of coincident faces.
# The error of the coordinates is added: see `margin_of` in renderer/bvh/slabs.py.
_FACING = np.float32(2.0**-20)
_W = np.uintp(WIDTH)
_CORNER = np.uintp(3 * WIDTH)
_CORNER_BYTES = np.uintp(3 * WIDTH * 4)


@device
def intersect_triangles(base, axes, shear, origin, margin, t_max):
    """Intersects a ray with the triangles of a packet; returns (mask8, f32x8 distance, barycentric of b, of c, determinant).

    Distance and barycentrics must still be divided by the determinant. The barycentrics are the weights of the corners b and c.
    margin: as for `intersect_corners`, which does the test.

    axes: row offsets (kx, ky, kz), where kz is the axis of the direction's largest component. shear: (d[kx]/d[kz], d[ky]/d[kz],
    1/d[kz]). origin: in the order of these axes. base: the packet's address.
    """
    kx, ky, kz = axes
    ox, oy, oz = splat(origin[0]), splat(origin[1]), splat(origin[2])
    a = load_from(base, kx) - ox, load_from(base, ky) - oy, load_from(base, kz) - oz
    base += _CORNER_BYTES
    b = load_from(base, kx) - ox, load_from(base, ky) - oy, load_from(base, kz) - oz
    base += _CORNER_BYTES
    c = load_from(base, kx) - ox, load_from(base, ky) - oy, load_from(base, kz) - oz
    return intersect_corners(a, b, c, shear, margin, t_max)


@device
def intersect_corners(a, b, c, shear, margin, t_max):
    """Intersects a ray with one triangle, or with eight in lanes; see `intersect_triangles` for the result.

    Watertight: Woop, Benthin & Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Two triangles compute the same
    value, except for its exact sign, for the edge function of a shared edge, so a ray cannot pass between them; edges belong to
    both. The products must be rounded before the difference (no fma), or the sign would not be exact.

    For two coincident faces back to back, rounding would decide which is nearer. Therefore distances of front faces are reduced,
    and those of back faces increased, by `_FACING` times the sum of distance and `margin`: the face towards the ray's origin is
    nearer, whatever their order, tessellation and space. With margin None, for shadow rays, distances are unchanged.

    a, b, c: the corners relative to the ray's origin, in the order of its axes. shear, margin, t_max: numbers.
    """
    zero = splat_like(a[0], _ZERO)
    sx = splat_like(zero, -shear[0])
    sy = splat_like(zero, -shear[1])
    ax, ay, az = fma(sx, a[2], a[0]), fma(sy, a[2], a[1]), a[2]
    bx, by, bz = fma(sx, b[2], b[0]), fma(sy, b[2], b[1]), b[2]
    cx, cy, cz = fma(sx, c[2], c[0]), fma(sy, c[2], c[1]), c[2]

    u = product(cx, by) - product(cy, bx)
    v = product(ax, cy) - product(ay, cx)
    w = product(bx, ay) - product(by, ax)
    # A hit if all three have the same sign, where 0 matches both. A determinant of 0 fails the distance test.
    inside = less_equal(zero, minimum(u, minimum(v, w))) | less_equal(maximum(u, maximum(v, w)), zero)
    determinant = u + v + w
    t = fma(u, az, fma(v, bz, w * cz)) * splat_like(zero, shear[2])
    if margin is not None:
        facing = flip(splat_like(zero, math.copysign(_FACING, -shear[2])), determinant)
        t = fma(fma(splat_like(zero, margin), determinant, t), facing, t)
    ahead = flip(t, determinant)
    hit = inside & less(zero, ahead) & less(ahead, flip(determinant, determinant) * splat_like(zero, t_max))
    return hit, t, v, w, determinant


@device
def is_beyond(after, limit, t, numbers):
    """Returns a mask8 of the primitives beyond the hit `after`: those farther away, or equally far with a number above `limit`.

    after: the hit's (distance, instance, primitive). t: the primitives' distances. numbers: the bits of their numbers, f32x8.
    """
    before = splat(after[0])
    return less(before, t) | (less_equal(before, t) & greater_ints(numbers, limit))


@subroutine
def intersect_spheres(base, origin, direction, t_max, after, limit, numbers):
    """Intersects a ray with the spheres of a packet; returns (mask8, f32x8 distance of the first hit with t > 0).

    after, limit, numbers: as for `is_beyond`, which then filters the hits; None: no filter.

    Computed in double precision: in single precision, the distance to a sphere of radius 1e5 would be wrong in its third decimal,
    and the sphere would cast rings of shadow on itself.
    """
    never_inline()
    f = (
        to_double(splat(origin[0])) - to_double(load_from(base, np.uintp(0))),
        to_double(splat(origin[1])) - to_double(load_from(base, _W)),
        to_double(splat(origin[2])) - to_double(load_from(base, _W + _W)),
    )
    d = to_double(splat(direction[0])), to_double(splat(direction[1])), to_double(splat(direction[2]))
    near, far = sphere_roots(f, d, to_double(load_from(base, _CORNER)), to_double(splat(_ZERO)))
    if after is not None:
        first, last = to_single(near), to_single(far)
        t = select(is_beyond(after, limit, first, numbers), first, last)
        return is_beyond(after, limit, t, numbers) & less(t, splat(t_max)), t
    t = to_single(select(less(to_double(splat(_ZERO)), near), near, far))
    return less(splat(_ZERO), t) & less(t, splat(t_max)), t


@device
def sphere_roots(f, d, radius, zero):
    """Returns both distances, in double precision, at which a ray's line meets a sphere, or eight in lanes; NaN if it misses.

    f: from the sphere's centre to the ray's origin. d: its direction. zero: 0 in the type of the result.
    """
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    b = zero - (f[0] * d[0] + f[1] * d[1] + f[2] * d[2])
    c = f[0] * f[0] + f[1] * f[1] + f[2] * f[2] - radius * radius
    root = sqrt(b * b - a * c)
    return (b - root) / a, (b + root) / a
