"""Rays with their derivatives by two parameters, and the half-vector constraint at an interface.

The parameters are the components, along two unit vectors, of a change of the ray's direction at its start: so the ratio of solid
angle at the start to area, or to solid angle, at the end is the inverse of a cross product. The rules are those of Igehy,
"Tracing Ray Differentials" (1999).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.manifold.caster import normal_change

__all__ = [
    "RayDerivatives",
    "arrive",
    "half_vector_step",
    "leave_plane",
    "leave_point",
    "perpendicular_area",
    "redirect",
    "solid_angle_area",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_LEAST = np.float32(1e-20)


class RayDerivatives(NamedTuple):
    """The unit direction d of a ray, and the derivatives of its origin and direction by two parameters u and v.

    u and v are components of a small change of the direction at the start of the chain of rays.
    """

    d: Any
    o_u: Any
    o_v: Any
    d_u: Any
    d_v: Any


@device
def leave_point(d):
    """Returns the RayDerivatives of a ray of unit direction d that starts at a fixed point."""
    e, f = vec.basis(d)
    return RayDerivatives(d, _BLACK, _BLACK, e, f)


@device
def leave_plane(d):
    """Returns the RayDerivatives of a ray of unit direction d by the place, on a plane perpendicular to d, where it starts."""
    e, f = vec.basis(d)
    return RayDerivatives(d, e, f, _BLACK, _BLACK)


@device
def _moved(o_x, d_x, d, t, normal, cosine):
    """Returns the derivative of the point o + t d on a plane. cosine: the dot product of d and the plane's normal."""
    free = vec.add(o_x, vec.scale(d_x, t))
    return vec.sub(free, vec.scale(d, vec.dot(normal, free) / cosine))


@device
def arrive(ray, t, normal):
    """Returns the derivatives of the point at distance t of a ray, on a plane with this normal: by u, and by v."""
    cosine = vec.dot(normal, ray.d)
    return _moved(ray.o_u, ray.d_u, ray.d, t, normal, cosine), _moved(ray.o_v, ray.d_v, ray.d, t, normal, cosine)


@device
def _reflected(d, d_x, n, n_x, cosine):
    change = vec.dot(d_x, n) + vec.dot(d, n_x)
    return vec.sub(d_x, vec.add(vec.scale(n, _TWO * change), vec.scale(n_x, -_TWO * cosine)))


@device
def _refracted(d, d_x, n, n_x, cosine, refracted, inverse):
    change = -vec.dot(d_x, n) - vec.dot(d, n_x)  # of `cosine`
    along = inverse * cosine - refracted
    along_x = inverse * change - inverse * inverse * cosine * change / refracted
    return vec.add(vec.scale(d_x, inverse), vec.add(vec.scale(n, along_x), vec.scale(n_x, along)))


@device
def redirect(ray, p_u, p_v, at, eta, reflects):
    """Returns (whether there is such a ray, its RayDerivatives) after reflection or refraction at a CasterPoint.

    p_u, p_v: from `arrive`. eta: index of refraction beyond the surface over that before it. reflects: False for refraction.
    """
    n, d = at.normal, ray.d
    cosine = -vec.dot(d, n)
    n_u, n_v = normal_change(at, p_u), normal_change(at, p_v)
    if reflects:
        out = vec.add(d, vec.scale(n, _TWO * cosine))
        exists = vec.dot(out, at.geometric) > _ZERO
        d_u, d_v = _reflected(d, ray.d_u, n, n_u, cosine), _reflected(d, ray.d_v, n, n_v, cosine)
        return exists, RayDerivatives(out, p_u, p_v, d_u, d_v)
    inverse = _ONE / eta
    square = _ONE - (_ONE - cosine * cosine) * inverse * inverse
    refracted = math.sqrt(max(square, _LEAST))
    out = vec.normalize(vec.add(vec.scale(d, inverse), vec.scale(n, inverse * cosine - refracted)))
    exists = square > _ZERO and vec.dot(out, at.geometric) < _ZERO
    d_u = _refracted(d, ray.d_u, n, n_u, cosine, refracted, inverse)
    d_v = _refracted(d, ray.d_v, n, n_v, cosine, refracted, inverse)
    return exists, RayDerivatives(out, p_u, p_v, d_u, d_v)


@device
def perpendicular_area(ray, t):
    """Returns the area, perpendicular to the ray at distance t, per solid angle at its start."""
    u, v = vec.add(ray.o_u, vec.scale(ray.d_u, t)), vec.add(ray.o_v, vec.scale(ray.d_v, t))
    return abs(vec.dot(vec.cross(u, v), ray.d))


@device
def solid_angle_area(ray):
    """Returns the solid angle of the ray's direction per solid angle at its start."""
    return abs(vec.dot(vec.cross(ray.d_u, ray.d_v), ray.d))


@device
def _change_along(axis, out_x, p_x, in_scale, eta, wi, normal_x, along_normal):
    """Returns the derivative, along an axis perpendicular to the normal, of the half vector's part perpendicular to the normal.

    out_x, p_x, normal_x: derivatives of the direction to the viewer, of the point and of the normal.
    """
    turned = vec.scale(vec.sub(p_x, vec.scale(wi, vec.dot(wi, p_x))), -in_scale)
    return vec.dot(axis, vec.add(out_x, vec.scale(turned, eta))) - along_normal * vec.dot(axis, normal_x)


@device
def half_vector_step(ray, p_u, p_v, at, eta, reflects, target, is_distant):
    """Returns (whether the lamp is on the right side, squared error, step of u, step of v) of Newton's method at an interface.

    The constraint: the half vector of the directions to the viewer and to the lamp, wo + eta wi (Walter et al. 2007; eta = 1 for
    reflection), is parallel to the shading normal. Its error is the half vector's part perpendicular to the normal: the
    difference of the two sides of Snell's law. Unlike the unit half vector, which changes fast where eta is near 1, that is
    nearly linear. target: the lamp's point, or if `is_distant` the direction to it.
    """
    wo = vec.neg(ray.d)
    wi, in_scale = target, _ZERO
    if not is_distant:
        way = vec.sub(target, at.point)
        in_scale = _ONE / vec.length(way)
        wi = vec.scale(way, in_scale)
    side = vec.dot(wi, at.geometric)
    if reflects:
        eta = _ONE
    is_beyond = side > _ZERO if reflects else side < _ZERO
    n = at.normal
    half = vec.add(wo, vec.scale(wi, eta))
    s, t = vec.basis(n)
    a, b, along_normal = vec.dot(half, s), vec.dot(half, t), vec.dot(half, n)
    o_u, o_v = vec.neg(ray.d_u), vec.neg(ray.d_v)
    n_u, n_v = normal_change(at, p_u), normal_change(at, p_v)
    m00 = _change_along(s, o_u, p_u, in_scale, eta, wi, n_u, along_normal)
    m01 = _change_along(s, o_v, p_v, in_scale, eta, wi, n_v, along_normal)
    m10 = _change_along(t, o_u, p_u, in_scale, eta, wi, n_u, along_normal)
    m11 = _change_along(t, o_v, p_v, in_scale, eta, wi, n_v, along_normal)
    determinant = m00 * m11 - m01 * m10
    inverse = _ONE / determinant if determinant != _ZERO else _ZERO
    return is_beyond, a * a + b * b, (m01 * b - m11 * a) * inverse, (m10 * a - m00 * b) * inverse
