"""Direction sampling from a mixture: half of the samples follow the material, half aim at guide targets such as lights.

As in Shirley, Black & Hollasch, "Ray Tracing: The Rest of Your Life": no shadow rays, one direction per bounce, weighted by the
mixture's density. Targets are chosen uniformly, and the density of each is evaluated, so their number should be small
(renderer/scene/guiding_targets.py). Light outside all targets is found by the material's half.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import eval_material, sample_material
from renderer.kernel.sampling.sphere_cone import sample_sphere_direction, sphere_direction_pdf
from renderer.kernel.sampling.warp import square_to_sphere, square_to_triangle
from renderer.kernel.steps.aim import unguided_factor
from renderer.kernel.steps.state import BsdfSample

__all__ = ["mixture_bounce", "sample_towards", "target_density"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INV_4PI = np.float32(0.25 / math.pi)
_BLACK = (_ZERO, _ZERO, _ZERO)
_NO = np.bool_(False)


@device
def _corner(scene, number, k):
    i = scene.triangle[number, k]
    return scene.position[i, 0], scene.position[i, 1], scene.position[i, 2]


@device
def _ball(scene, number):
    return (scene.sphere[number, 0], scene.sphere[number, 1], scene.sphere[number, 2]), scene.sphere[number, 3]


@device
def _is_inside(center, radius, p):
    to_center = vec.sub(center, p)
    return vec.dot(to_center, to_center) <= radius * radius


@device
def target_density(scene, primitive, p, d):
    """Returns the density, per steradian, with which `sample_towards` samples the unit direction d from p towards a primitive.

    The density is 0 if d misses the primitive.
    """
    triangles = len(scene.triangle)
    if primitive >= triangles:
        center, radius = _ball(scene, primitive - triangles)
        return _INV_4PI if _is_inside(center, radius, p) else sphere_direction_pdf(center, radius, p, d, _NO)
    # Moeller & Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997
    a = _corner(scene, primitive, 0)
    b = vec.sub(_corner(scene, primitive, 1), a)
    c = vec.sub(_corner(scene, primitive, 2), a)
    across = vec.cross(d, c)
    determinant = vec.dot(b, across)
    if determinant == _ZERO:
        return _ZERO
    inverse = _ONE / determinant
    from_a = vec.sub(p, a)
    u = vec.dot(from_a, across) * inverse
    side = vec.cross(from_a, b)
    v = vec.dot(d, side) * inverse
    t = vec.dot(c, side) * inverse
    if u < _ZERO or v < _ZERO or u + v > _ONE or t <= _ZERO:
        return _ZERO
    return _TWO * t * t / abs(determinant)  # |determinant| is twice the area times the cosine


@device
def sample_towards(scene, primitive, p, u):
    """Samples a direction from p towards a primitive: (unit direction, density per steradian; 0 if there is none).

    Triangles are sampled by area, spheres by solid angle, or from inside uniformly over all directions.
    """
    triangles = len(scene.triangle)
    if primitive >= triangles:
        center, radius = _ball(scene, primitive - triangles)
        if _is_inside(center, radius, p):
            return square_to_sphere(u), _INV_4PI
        return sample_sphere_direction(center, radius, p, u)
    v, w = square_to_triangle(u)
    a = _corner(scene, primitive, 0)
    b = vec.sub(_corner(scene, primitive, 1), a)
    c = vec.sub(_corner(scene, primitive, 2), a)
    d = vec.sub(vec.add(a, vec.add(vec.scale(b, v), vec.scale(c, w))), p)
    square = vec.dot(d, d)
    if not square > _ZERO:
        return d, _ZERO
    d = vec.scale(d, _ONE / math.sqrt(square))
    projected = abs(vec.dot(vec.cross(b, c), d))
    return d, _TWO * square / projected if projected > _ZERO else _ZERO


@subroutine
def mixture_bounce(scene, p, frame, material, wo, choose, u):
    """Samples a direction from the mixture; returns a BsdfSample.

    Its pdf is 0, so that emission hit by the ray has the full MIS weight. p: the point. frame: its shading frame (s, t,
    n). Discrete directions come only from the material's half.
    """
    never_inline()
    s, q, n = frame
    count = len(scene.guide)
    if count == 0:
        wi, weight, _, thinned = sample_material(material, wo, choose, u)
        return BsdfSample(wi, weight, _ZERO, thinned, _ONE)
    aimed = -1
    aimed_density = _ZERO
    if choose < _HALF:
        wi, weight, pdf, thinned = sample_material(material, wo, _TWO * choose, u)
        if pdf == _ZERO:
            return BsdfSample(wi, vec.scale(weight, _TWO), _ZERO, thinned, _HALF)
        d = vec.to_world(s, q, n, wi)
    else:
        aimed = min(np.int64((_TWO * choose - _ONE) * np.float32(count)), count - 1)
        d, aimed_density = sample_towards(scene, scene.guide[aimed], p, u)
        if aimed_density == _ZERO:
            return BsdfSample(wo, _BLACK, _ZERO, _ONE, _ONE)
        wi = vec.to_local(s, q, n, d)
    f, own = eval_material(material, wo, wi)
    total = _ZERO
    for i in range(count):
        # By rounding, a direction aimed at a target's rim may seem to miss it.
        total += aimed_density if i == aimed else target_density(scene, scene.guide[i], p, d)
    density = _HALF * own + _HALF * total / np.float32(count)
    if not density > _ZERO:
        return BsdfSample(wi, _BLACK, _ZERO, _ONE, _ONE)
    return BsdfSample(wi, vec.scale(f, _ONE / density), _ZERO, _ONE, unguided_factor(density, own))
