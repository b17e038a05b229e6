"""Inputs of motion vectors: world positions, at shutter opening, middle and closing, of the points seen at pixel centres.

One ray per pixel is traced through the centres of pixel and lens, at the middle of the shutter. Positions are computed in float64
at the shutter's keys, so that their difference has no float32 rounding noise.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import LAMP, TRANSPARENT
from renderer.bvh.motion import step_at, transform_at
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit
from renderer.jit import device, entry, never_inline, subroutine
from renderer.kernel.camera import moving_ray
from renderer.kernel.material.material import has_flag, opacity
from renderer.kernel.surface.surface import owner_at, surface_at
from renderer.reference import by_reference

__all__ = ["in_camera_space", "next_visible", "trace_motion_points", "write_place"]

_INF = np.float32(np.inf)
_LAMP, _TRANSPARENT = np.uint32(LAMP), np.uint32(TRANSPARENT)
_HALF = np.float32(0.5)
_OPENS, _CLOSES = np.float32(0.0), np.float32(1.0)
_MIDDLE = (_HALF, _HALF)


@device
def _interpolated(fixed, moving, keys, i, column, time):
    """Returns an element of row i at a shutter time, float64, interpolated between the two nearest keys.

    The row is in `moving` if it is one of the last rows, which have keys, else in `fixed`.
    """
    count = len(moving) // keys if keys > 0 else 0
    first = len(fixed) - count
    if i < first:
        return np.float64(fixed[i, column])
    step, share = step_at(time, keys)
    a = np.float64(moving[step * count + i - first, column])
    b = np.float64(moving[(step + 1) * count + i - first, column])
    return b if share == _CLOSES else a + np.float64(share) * (b - a)


@device
def _row(fixed, moving, keys, i, time):
    """Returns the first three columns of vertex row i at a shutter time."""
    x = _interpolated(fixed, moving, keys, i, 0, time)
    y = _interpolated(fixed, moving, keys, i, 1, time)
    return x, y, _interpolated(fixed, moving, keys, i, 2, time)


@subroutine
def _triangle_position(scene, hit, time):
    """Returns the world position, float64, of the point hit on a triangle, at a shutter time."""
    never_inline()
    keys = np.int64(scene.bvh.keyed_packets[1])
    corners = scene.triangle[hit.primitive]
    a = _row(scene.position, scene.key_position, keys, np.int64(corners[0]), time)
    b = _row(scene.position, scene.key_position, keys, np.int64(corners[1]), time)
    c = _row(scene.position, scene.key_position, keys, np.int64(corners[2]), time)
    u, v = np.float64(hit.u), np.float64(hit.v)
    w = 1.0 - u - v
    x = w * a[0] + u * b[0] + v * c[0]
    y = w * a[1] + u * b[1] + v * c[1]
    z = w * a[2] + u * b[2] + v * c[2]
    if hit.instance < 0:
        return x, y, z
    if len(scene.bvh.instance_motion) > 0:
        first, count = scene.bvh.instance_motion[hit.instance, 0], scene.bvh.instance_motion[hit.instance, 1]
        if count > 0:
            p, q, r = transform_at(scene.bvh.motion, first, count, time)
            return (
                p[0] * x + p[1] * y + p[2] * z + p[3],
                q[0] * x + q[1] * y + q[2] * z + q[3],
                r[0] * x + r[1] * y + r[2] * z + r[3],
            )
    m = scene.to_world[hit.instance]
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
    )


@subroutine
def _sphere_position(scene, hit, o, d, time):
    """Returns the world position, float64, of the point hit on a sphere, at a shutter time.

    Spheres do not rotate, so the point's direction from the centre is constant.
    """
    never_inline()
    keys = np.int64(scene.bvh.keyed_packets[1])
    i = np.int64(hit.primitive) - len(scene.triangle)
    c = _row(scene.sphere, scene.key_sphere, keys, i, hit.time)
    t = np.float64(hit.t)
    x, y, z = o[0] + t * d[0] - c[0], o[1] + t * d[1] - c[1], o[2] + t * d[2] - c[2]
    scale = _interpolated(scene.sphere, scene.key_sphere, keys, i, 3, time) / math.sqrt(x * x + y * y + z * z)
    c = _row(scene.sphere, scene.key_sphere, keys, i, time)
    return c[0] + scale * x, c[1] + scale * y, c[2] + scale * z


@subroutine
def next_visible(scene, stack, o, d, t_max, time, after):
    """Returns the first Hit along the ray, beyond the hit `after`, whose surface has an opacity of at least 1/2 there.

    t_max, time, after: as for `closest_hit`; FROM_ORIGIN for the first surface.
    """
    never_inline()
    root = camera_root(scene.bvh)
    while True:
        hit = closest_hit(scene.bvh, stack, o, d, t_max, time, root, after)
        if hit.primitive == NO_PRIMITIVE:
            break
        _, material = owner_at(scene, hit)
        if scene.has.textures is None or not has_flag(scene, material, _LAMP):
            if not has_flag(scene, material, _TRANSPARENT):
                break
            surface = surface_at(scene, o, d, hit)
            if opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], _HALF) >= _HALF:
                break
        after = hit.t, hit.instance, hit.primitive
    return hit


@device
def _write(places, y, x, which, place, near):
    places[y, x, which, 0] = place[0]
    places[y, x, which, 1] = place[1]
    places[y, x, which, 2] = place[2]
    places[y, x, which, 3] = near


@subroutine
def write_place(scene, hit, o, d, y, x, which, time, places):
    """Writes element (y, x, which) of `places`, (h, w, n, 4) float64: where the point of a Hit of the ray o + t d is at a time.

    The last number is 1; without a hit, the ray's direction and 0.
    """
    never_inline()
    if hit.primitive == NO_PRIMITIVE:
        _write(places, y, x, which, (np.float64(d[0]), np.float64(d[1]), np.float64(d[2])), 0.0)
    elif hit.primitive < len(scene.triangle):
        _write(places, y, x, which, _triangle_position(scene, hit, time), 1.0)
    else:
        _write(places, y, x, which, _sphere_position(scene, hit, o, d, time), 1.0)


@subroutine
def _see_places(scene, stack, camera, top, places):
    never_inline()
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            o, d, _ = moving_ray(camera, np.float32(x) + _HALF, np.float32(top + y) + _HALF, _MIDDLE, _HALF)
            hit = next_visible(scene, stack, o, d, _INF, _HALF, FROM_ORIGIN)
            for which in range(3):
                time = _OPENS if which == 0 else _HALF if which == 1 else _CLOSES
                write_place(scene, hit, o, d, y, x, which, time, places)


@entry
def trace_motion_points(scene, stack, camera, top, places):
    """Fills `places`, (h, w, 3, 4) float64, for h rows of pixels from row `top` on.

    For each of the three times: a world point (x, y, z, 1), or if nothing is hit the ray's direction and 0. scene: in the variant
    for moving scenes. stack: from new_stack.
    """
    _see_places(by_reference(scene), stack, camera, top, places)


@entry
def in_camera_space(places, axes, eye, found):
    """Fills `found`, (3, h, w) float64: coordinates x, y and z of points along a camera's axes.

    places: (h, w, 4) float64, points with a last column of 1, or directions with 0. axes: (3, 3) float64, a row each. eye: (3,).
    """
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            near = places[y, x, 3]
            e, f, g = near * eye[0], near * eye[1], near * eye[2]  # rounded: NumPy fuses no products with sums
            a, b, c = places[y, x, 0] - e, places[y, x, 1] - f, places[y, x, 2] - g
            for k in range(3):
                p, q, r = a * axes[k, 0], b * axes[k, 1], c * axes[k, 2]
                found[k, y, x] = (p + q) + r
