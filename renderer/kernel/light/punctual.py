"""Punctual lights: point, spot and distant lights, in the units of Light (renderer/scene/description.py).

With an extent they are spheres, disks and cones of constant radiance, which soften shadows. Rays do not intersect them, except
for suns: distant lights with an angle.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.motion import step_at
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import acos
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf, square_to_sphere

__all__ = [
    "DIRECTIONAL",
    "POINT",
    "SPOT",
    "SPOT_LINEAR",
    "SPOT_SMOOTH",
    "SPOT_SMOOTH_ANGLE",
    "SUN",
    "SUN_UNSEEN",
    "disk_cone",
    "moving_sun",
    "sample_moving_punctual",
    "sample_punctual",
]

# Kinds of punctual lights, as in `punctual_kind`. The last two are distant lights that rays hit, SUN_UNSEEN only by rays not from
# the camera. New kinds must be inserted before these two.
POINT, SPOT, DIRECTIONAL, SPOT_SMOOTH, SPOT_LINEAR, SPOT_SMOOTH_ANGLE, SUN, SUN_UNSEEN = range(8)

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_THREE = np.float32(3.0)
_INFINITE_DISTANCE = np.float32(1e18)
_INV_4PI = np.float32(0.25 / math.pi)
_UP = (_ZERO, _ZERO, _ONE)
_NOWHERE = (_ZERO, _ZERO, _ZERO)


@device
def spot_falloff(kind, cosine, scale, offset):
    """Returns a spot light's relative intensity, 0 ... 1, at position x between the outer edge (0) and the inner edge (1).

    The kind determines the curve:

    SPOT: x**2, with x linear in the cosine (KHR_lights_punctual, "Inner and Outer Cone Angles").
    SPOT_SMOOTH: smoothstep of x, with x linear in the cosine (Cycles' spot_light_attenuation; pbrt 4ed, 12.2.1).
    SPOT_LINEAR: x, linear in the angle (Mitsuba's plugin spot).
    SPOT_SMOOTH_ANGLE: smoothstep of x, linear in the angle (UsdLuxShapingAPI, shaping:cone:softness).

    cosine: of the angle to the spot's axis. x is the cosine or the angle, times scale plus offset, clamped to 0 ... 1.
    """
    by = acos(cosine) if kind == SPOT_LINEAR or kind == SPOT_SMOOTH_ANGLE else cosine  # noqa: SIM109 -- kernels compare kinds one by one
    inside = min(max(by * scale + offset, _ZERO), _ONE)
    if kind == SPOT:
        return inside * inside
    if kind == SPOT_LINEAR:
        return inside
    return inside * inside * (_THREE - _TWO * inside)


@device
def _sphere_towards(axis, distance, radius, u):
    """Samples a direction to a sphere seen from outside, uniform in solid angle.

    Returns (unit world direction, distance to its near side, pdf per steradian).
    """
    sine2 = (radius / distance) * (radius / distance)
    one_minus_cos = sine2 / (_ONE + math.sqrt(max(_ZERO, _ONE - sine2)))
    local = square_to_cone(u, one_minus_cos)
    s, t = vec.basis(axis)
    off2 = distance * distance * (local[0] * local[0] + local[1] * local[1])
    near = distance * local[2] - math.sqrt(max(_ZERO, radius * radius - off2))
    return vec.to_world(s, t, axis, local), near, square_to_cone_pdf(one_minus_cos)


@device
def _is_distant(kind):
    return kind == DIRECTIONAL or kind >= SUN


@device
def disk_cone(square, radius):
    """Returns 1 - cos of the half angle subtended by a disk that faces the viewer. square: squared distance of its centre."""
    sine2 = radius * radius / (square + radius * radius)
    return sine2 / (_ONE + math.sqrt(max(_ZERO, _ONE - sine2)))


@subroutine
def sample_punctual(kinds, rows, number, p, u):
    """Samples punctual light `number` from p; returns (direction, end, radiance, pdf), as in a LightSample.

    For a light without extent the pdf is 1 and the radiance is the irradiance at normal incidence.
    """
    return _sample(kinds[number], row(rows, number, 12), p, u)


@subroutine
def sample_moving_punctual(kinds, keys, number, p, u, time):
    """Samples a moving punctual light at a shutter time; returns the tuple of `sample_punctual`.

    keys: (J, 12), the same number of keys for each light, interpolated linearly.
    """
    count = len(keys) // len(kinds)
    step, share = step_at(time, count)
    a, b = row(keys, number * count + step, 12), row(keys, number * count + step + 1, 12)
    place, shines = _mixed(a, b, 0, share), _mixed(a, b, 3, share)
    if _is_distant(kinds[number]):
        place = vec.normalize(place)
    else:
        shines = vec.normalize(shines) if vec.dot(shines, shines) > _ZERO else shines
    value, rest = _mixed(a, b, 6, share), _mixed(a, b, 9, share)
    return _sample(kinds[number], (*place, *shines, *value, *rest), p, u)


@subroutine
def moving_sun(kinds, keys, number, time):
    """Returns a moving sun at a shutter time: (direction to it, radiance, 1 - cos of its half angle).

    keys: (J, 12), the same number of keys for each light, interpolated linearly.
    """
    count = len(keys) // len(kinds)
    step, share = step_at(time, count)
    a, b = row(keys, number * count + step, 12), row(keys, number * count + step + 1, 12)
    return vec.normalize(_mixed(a, b, 0, share)), _mixed(a, b, 6, share), a[9] + share * (b[9] - a[9])


@device
def _mixed(a, b, k, share):
    return a[k] + share * (b[k] - a[k]), a[k + 1] + share * (b[k + 1] - a[k + 1]), a[k + 2] + share * (b[k + 2] - a[k + 2])


@device
def _sample(kind, light, p, u):
    """Samples a punctual light given by its row of 12 numbers; see `sample_punctual`."""
    place, shines, value = light[0:3], light[3:6], light[6:9]
    extent = light[9]
    if _is_distant(kind):
        pdf = _ONE
        w = place
        if extent > _ZERO:
            s, t = vec.basis(place)
            w = vec.to_world(s, t, place, square_to_cone(u, extent))
            pdf = square_to_cone_pdf(extent)
        return w, vec.add(p, vec.scale(w, _INFINITE_DISTANCE)), value, pdf
    d = vec.sub(place, p)
    square = vec.dot(d, d)
    if not square > _ZERO:
        return _UP, _NOWHERE, _NOWHERE, _ZERO
    distance = math.sqrt(square)
    axis = vec.scale(d, _ONE / distance)
    strength = _ONE
    if extent < _ZERO:  # a disk that faces p; a spot's falloff depends on each sample's direction
        cone = disk_cone(square, extent)
        s, t = vec.basis(axis)
        local = square_to_cone(u, cone)
        w = vec.to_world(s, t, axis, local)
        if kind != POINT:
            strength = spot_falloff(kind, -vec.dot(w, shines), light[10], light[11])
        return w, vec.add(p, vec.scale(w, distance / local[2])), vec.scale(value, strength), square_to_cone_pdf(cone)
    if kind != POINT:  # from the centre, so that an extent does not blur the cone
        strength = spot_falloff(kind, -vec.dot(axis, shines), light[10], light[11])
    if extent == _ZERO:
        return axis, place, vec.scale(value, strength / square), _ONE
    if distance > extent:
        w, far, pdf = _sphere_towards(axis, distance, extent, u)
        return w, vec.add(p, vec.scale(w, far)), vec.scale(value, strength), pdf
    # Inside, constant radiance from all directions: continuous at the sphere's surface, and bounded.
    w = square_to_sphere(u)
    along = vec.dot(d, w)
    far = along + math.sqrt(max(_ZERO, along * along + extent * extent - square))
    return w, vec.add(p, vec.scale(w, far)), vec.scale(value, strength), _INV_4PI
