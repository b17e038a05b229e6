"""One ray against eight triangles, or against eight spheres, at once."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import PACKET_SIZE, WIDTH
from renderer.bvh.simd import fma, less, less_equal, load, not_equal, select, splat, sqrt, to_double, to_single
from renderer.jit import device

__all__ = ["meet_spheres", "meet_triangles"]

_ZERO = np.float32(0.0)
_W = np.uintp(WIDTH)
_CORNER = np.uintp(3 * WIDTH)
_SIZE = np.uintp(PACKET_SIZE)


@device
def meet_triangles(packet, number, axes, shear, origin, t_max):
    """Where the ray meets the triangles of a packet: (mask8, f32x8 distance, f32x8 barycentric of b, f32x8 of c).

    Watertight: Woop, Benthin & Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Two triangles compute the
    same edge function of a shared edge, but for its exact sign, so a ray cannot pass between them; edges belong to both.
    The products must be rounded before the difference (no fma), or the sign would not be exact.

    axes: row offsets (kx, ky, kz), kz of the direction's largest component; shear: (d[kx]/d[kz], d[ky]/d[kz], 1/d[kz]);
    origin: f32x8 each, permuted alike.
    """
    kx, ky, kz = axes
    ox, oy, oz = origin
    base = number * _SIZE
    sx = splat(-shear[0])
    sy = splat(-shear[1])
    az = load(packet, base + kz) - oz
    ax = fma(sx, az, load(packet, base + kx) - ox)
    ay = fma(sy, az, load(packet, base + ky) - oy)
    base += _CORNER
    bz = load(packet, base + kz) - oz
    bx = fma(sx, bz, load(packet, base + kx) - ox)
    by = fma(sy, bz, load(packet, base + ky) - oy)
    base += _CORNER
    cz = load(packet, base + kz) - oz
    cx = fma(sx, cz, load(packet, base + kx) - ox)
    cy = fma(sy, cz, load(packet, base + ky) - oy)

    u = cx * by - cy * bx
    v = ax * cy - ay * cx
    w = bx * ay - by * ax
    zero = splat(_ZERO)
    front = less_equal(zero, u) & less_equal(zero, v) & less_equal(zero, w)
    back = less_equal(u, zero) & less_equal(v, zero) & less_equal(w, zero)
    determinant = u + v + w
    inverse = splat(np.float32(1.0)) / determinant
    t = fma(u, az, fma(v, bz, w * cz)) * splat(shear[2]) * inverse
    hit = (front | back) & not_equal(determinant, zero) & less(zero, t) & less(t, splat(t_max))
    return hit, t, v * inverse, w * inverse


@device
def meet_spheres(packet, number, origin, direction, t_max):
    """Where the ray first meets the spheres of a packet ahead of its origin: (mask8, f32x8 distance).

    In double precision: in single, the distance to a sphere of radius 1e5 would be wrong by its third decimal, and the
    sphere would shadow itself in rings.
    """
    base = number * _SIZE
    fx = to_double(splat(origin[0])) - to_double(load(packet, base))
    fy = to_double(splat(origin[1])) - to_double(load(packet, base + _W))
    fz = to_double(splat(origin[2])) - to_double(load(packet, base + _W + _W))
    radius = to_double(load(packet, base + _CORNER))
    dx = to_double(splat(direction[0]))
    dy = to_double(splat(direction[1]))
    dz = to_double(splat(direction[2]))
    zero = to_double(splat(_ZERO))
    a = dx * dx + dy * dy + dz * dz
    b = zero - (fx * dx + fy * dy + fz * dz)
    c = fx * fx + fy * fy + fz * fz - radius * radius
    root = sqrt(b * b - a * c)  # NaN, and so no hit below, where the ray's line misses
    near = (b - root) / a
    far = (b + root) / a
    t = to_single(select(less(zero, near), near, far))
    return less(splat(_ZERO), t) & less(t, splat(t_max)), t
