"""Sphere lights, sampled by solid angle, either as whole spheres or as disks that face the shaded point."""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import FACING
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.light.light_sample import LightSample, emitted, if_found
from renderer.kernel.light.punctual import disk_cone
from renderer.kernel.sampling.sphere_cone import sphere_cone
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf, square_to_sphere
from renderer.kernel.surface.ray_origins import leave
from renderer.kernel.surface.shapes import ball_at
from renderer.kernel.surface.surface import sphere_uv
from renderer.wide.values import any_of, as_wide, lookup, not_, u32, where, where3, zero_like

__all__ = ["faces_viewer", "hits_emitting_side", "sample_facing", "sample_sphere", "sphere_light_pdf"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INV_4PI = np.float32(0.25 / math.pi)
_ERROR = np.float32(32 * 2.0**-24)
_MIN_DISTANCE2 = np.float32(1.001)  # squared distance in radii; nearer points may be on the sphere, by rounding
_LEAST = np.float32(1e-30)
_FIRST = np.uint32(0)
_FACING = np.uint32(FACING)


@device
def _sample_cap(to_center, square, radius, u):
    """Samples the visible cap of a sphere seen from outside, uniformly in solid angle.

    Returns (the sphere's world-space normal at the sample, pdf per steradian).
    """
    one_minus_cos = sphere_cone(square, radius)
    local = square_to_cone(u, one_minus_cos)
    axis = vec.scale(to_center, _ONE / math.sqrt(square))
    s, t = vec.basis(axis)
    # The point on the sphere from the cone's angle theta, without cancellation: pbrt 4ed, 6.2.4.
    sine2 = local[0] * local[0] + local[1] * local[1]
    most2 = radius * radius / square
    ratio = min(_ONE, sine2 / most2)
    cos_alpha = sine2 / math.sqrt(most2) + local[2] * math.sqrt(max(_ZERO, _ONE - ratio))
    sin_alpha = math.sqrt(max(_ZERO, _ONE - cos_alpha * cos_alpha))
    stretch = where(sine2 > _ZERO, sin_alpha / math.sqrt(sine2), _ZERO)
    normal = vec.to_world(s, t, axis, (local[0] * stretch, local[1] * stretch, -cos_alpha))
    return normal, square_to_cone_pdf(one_minus_cos)


@device
def _sphere(scene, number, time):
    """Returns (centre, radius) of sphere `number` at the shutter time."""
    x, y, z, radius = ball_at(scene, number, time)
    return (x, y, z), radius


@device
def sample_sphere(scene, number, p, u, time):
    """Samples a point on a sphere light, uniformly in solid angle from p; by area if p is inside or close. Returns a LightSample.

    The pdf excludes the probability of choosing the light.
    """
    center, radius = _sphere(scene, number, time)
    to_center = vec.sub(center, p)
    square = vec.dot(to_center, to_center)
    outside = square > _MIN_DISTANCE2 * radius * radius
    pdf = zero_like(square)
    normal = pdf, pdf, pdf
    if any_of(outside):
        normal, pdf = _sample_cap(to_center, square, radius, u)
    if any_of(not_(outside)):
        normal = where3(outside, normal, square_to_sphere(u))
    q = vec.add(center, vec.scale(normal, radius))
    d = vec.sub(q, p)
    far2 = vec.dot(d, d)
    w = vec.scale(d, _ONE / math.sqrt(far2))
    cosine = -vec.dot(normal, w)
    if any_of(not_(outside)):
        pdf = where(outside, pdf, far2 * _INV_4PI / (abs(cosine) * radius * radius))
    uv = zero_like(square), zero_like(square)
    if scene.has.textures is not None:
        uv = sphere_uv(normal)
    material = u32(lookup(scene.sphere_material, number))
    radiance = emitted(scene, material, uv, uv, as_wide(_ONE, square), outside | (cosine > _ZERO), time)
    error = _ERROR * (vec.magnitude(center) + radius)
    sample = LightSample(w, leave(q, error, normal, vec.neg(w)), radiance, pdf, as_wide(False, square))
    return if_found((far2 > _ZERO) & (outside | (cosine != _ZERO)), sample, p)


@device
def faces_viewer(scene, number):
    """Returns True if a sphere light acts as a disk through its centre that faces the shaded point, like Cycles' soft falloff."""
    facing = as_wide(False, number)
    if scene.has.textures is not None:
        facing = u32(lookup(scene.material_flags, u32(lookup(scene.sphere_material, number)))) & _FACING != _FIRST
    return facing


@device
def sample_facing(scene, number, p, u, time):
    """Samples a sphere light that acts as a disk facing p; returns a LightSample like `sample_sphere`."""
    center, radius = _sphere(scene, number, time)
    to_center = vec.sub(center, p)
    square = vec.dot(to_center, to_center)
    distance = math.sqrt(square)
    axis = vec.scale(to_center, _ONE / distance)
    cone = disk_cone(square, radius)
    local = square_to_cone(u, cone)
    s, t = vec.basis(axis)
    w = vec.to_world(s, t, axis, local)
    q = vec.add(p, vec.scale(w, distance / local[2]))
    material = u32(lookup(scene.sphere_material, number))
    uv = zero_like(square), zero_like(square)
    radiance = emitted(scene, material, uv, uv, as_wide(_ONE, square), square == square, time)
    error = _ERROR * (vec.magnitude(center) + radius)
    sample = LightSample(w, leave(q, error, axis, vec.neg(w)), radiance, square_to_cone_pdf(cone), as_wide(False, square))
    return if_found((square > _ZERO) & (local[2] > _ZERO), sample, p)


@device
def hits_emitting_side(scene, light, p, w, front, time):
    """Returns True if a ray from the vertex p in direction w that hit a light hit its emitting side.

    front: whether it hit the front side. For a sphere that acts as a disk facing p, the ray must pass through the disk, and only
    one of its two intersections with the sphere is valid.
    """
    if scene.has.textures is not None and len(scene.sphere) > 0:
        number = u32(u32(lookup(scene.light_primitive, light)) - np.uint32(len(scene.triangle)))
        is_ball = number < np.uint32(len(scene.sphere))
        number = where(is_ball, number, _FIRST)
        facing = is_ball & faces_viewer(scene, number)
        if any_of(facing):
            center, radius = _sphere(scene, number, time)
            d = vec.sub(center, p)
            square, along, off = vec.dot(d, d), vec.dot(d, w), vec.cross(d, w)
            on_disk = (along > _ZERO) & (vec.dot(off, off) * square < radius * radius * along * along)
            outside = square > radius * radius
            first = (front & outside) | not_(front | outside)  # otherwise the disk has already been counted
            front = (facing & on_disk & first) | (front & not_(facing))
    return front


@device
def sphere_light_pdf(scene, number, p, square, cosine, chance, time):
    """Returns the pdf, per steradian, of a sphere light's point at squared distance `square`.

    chance: probability of choosing the light. cosine: of the angle between the ray and the sphere's normal.
    """
    center, radius = _sphere(scene, number, time)
    to_center = vec.sub(center, p)
    center2 = vec.dot(to_center, to_center)
    facing = faces_viewer(scene, number)
    outside = facing | (center2 > _MIN_DISTANCE2 * radius * radius)
    pdf = chance * square_to_cone_pdf(where(facing, disk_cone(center2, radius), sphere_cone(center2, radius)))
    if any_of(not_(outside)):
        pdf = where(outside, pdf, chance * square * _INV_4PI / max(cosine * radius * radius, _LEAST))
    return pdf
