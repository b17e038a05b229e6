"""Light sampling: a light is chosen (the environment by a set probability, few others by power, many by a tree), then a point
or direction.

Triangles are sampled uniformly by area, spheres by the solid angle they fill, environments by their light; lights without a
body have a file of their own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays.rows import PART_COLUMNS, PART_MATERIAL, TEXTURED
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.light.environment import choose, environment_light, environment_radiance, sample_environment
from renderer.kernel.light.light_tree import choose_from_tree, tree_chance
from renderer.kernel.light.punctual import sample_punctual
from renderer.kernel.material.material import emission, opacity
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf, square_to_sphere, square_to_triangle
from renderer.kernel.surface.surface import leave, sphere_uv, triangle_point, triangle_uv

__all__ = [
    "LightSample",
    "choose_light",
    "environment_seen",
    "primitive_light_pdf",
    "sample_light",
    "sample_one_light",
]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FAR = np.float32(1e18)
_INV_4PI = np.float32(0.25 / math.pi)
_ERROR = np.float32(32 * 2.0**-24)
_CLOSE = np.float32(1.001)  # squared distance in radii: nearer, rounding could take a point on the sphere for one outside
_BLACK = (_ZERO, _ZERO, _ZERO)
_NO_UV = (_ZERO, _ZERO)
_NO_SAMPLE_W = (_ZERO, _ZERO, _ONE)


class LightSample(NamedTuple):
    """A direction that light comes from. Vectors are tuples of float32 in world space."""

    direction: tuple[float, float, float]  # unit, from the point lit
    end: tuple[float, float, float]  # what must be seen from the point lit
    radiance: tuple[float, float, float]  # that would arrive unoccluded
    pdf: float  # per steradian, the choice of the light included; 0: nothing sampled
    alone: bool  # whether only light sampling finds it (it has no body), so that there is nothing to weigh it against


@device
def _nothing():
    return LightSample(_NO_SAMPLE_W, _BLACK, _BLACK, _ZERO, False)


@device
def _vertex_alpha(scene, number, b, c):
    i, j, k, _ = row(scene.triangle, number, 4)
    return (_ONE - b - c) * row(scene.color, i, 4)[3] + b * row(scene.color, j, 4)[3] + c * row(scene.color, k, 4)[3]


@device
def _emitted(scene, material, uv, uv1, vertex_alpha, front):
    """What rays that meet the light there receive on average: those that its alpha lets pass receive nothing of it."""
    return vec.scale(emission(scene, material, uv, uv1, front), opacity(scene, material, uv, uv1, vertex_alpha))


@device
def _sample_triangle(scene, number, area, p, u):
    """A point of a triangle, uniformly: a LightSample, its pdf without the choice of the light."""
    b, c = square_to_triangle(u)
    q, error, normal = triangle_point(scene.position, scene.triangle, number, b, c)
    d = vec.sub(q, p)
    square = vec.dot(d, d)
    w = vec.scale(d, _ONE / math.sqrt(square))
    projected = -vec.dot(normal, w)  # twice the area, seen from p
    if not (square > _ZERO and abs(projected) > _ZERO):
        return _nothing()
    part = row(scene.triangle, number, 4)[3]
    material = np.uint32(row(scene.part, part, PART_COLUMNS)[PART_MATERIAL])
    uv = uv1 = _NO_UV
    alpha = _ONE
    if scene.has.textures is not None:
        uv = triangle_uv(scene.uv, scene.triangle, number, b, c) if scene.material_flags[material] & TEXTURED != 0 else _NO_UV
        uv1 = triangle_uv(scene.uv1, scene.triangle, number, b, c) if len(scene.uv1) > 0 else uv
        alpha = _vertex_alpha(scene, number, b, c) if len(scene.color) > 0 else _ONE
    radiance = _emitted(scene, material, uv, uv1, alpha, projected > _ZERO)
    end = leave(q, error, vec.scale(normal, _HALF / area), vec.neg(w))
    return LightSample(w, end, radiance, _TWO * square / abs(projected), False)


@device
def _cone(square, radius):
    """1 - cos of the half angle under which a sphere is seen from outside, at distance**2 `square`."""
    sine2 = radius * radius / square
    return sine2 / (_ONE + math.sqrt(max(_ZERO, _ONE - sine2)))


@device
def _sample_sphere(scene, number, p, u):
    """A point of a sphere, uniform in the solid angle seen from p (from inside or close by, by area): as `_sample_triangle`."""
    center = (scene.sphere[number, 0], scene.sphere[number, 1], scene.sphere[number, 2])
    radius = scene.sphere[number, 3]
    to_center = vec.sub(center, p)
    square = vec.dot(to_center, to_center)
    cone = square > _CLOSE * radius * radius
    if cone:
        one_minus_cos = _cone(square, radius)
        local = square_to_cone(u, one_minus_cos)
        axis = vec.scale(to_center, _ONE / math.sqrt(square))
        s, t = vec.basis(axis)
        # The point on the sphere from the cone's angle theta, without cancellation: pbrt 4ed, 6.2.4.
        sine2 = local[0] * local[0] + local[1] * local[1]
        most2 = radius * radius / square
        ratio = min(_ONE, sine2 / most2)
        cos_alpha = sine2 / math.sqrt(most2) + local[2] * math.sqrt(max(_ZERO, _ONE - ratio))
        sin_alpha = math.sqrt(max(_ZERO, _ONE - cos_alpha * cos_alpha))
        stretch = sin_alpha / math.sqrt(sine2) if sine2 > _ZERO else _ZERO
        normal = vec.to_world(s, t, axis, (local[0] * stretch, local[1] * stretch, -cos_alpha))
        pdf = square_to_cone_pdf(one_minus_cos)
    else:
        normal = square_to_sphere(u)
        pdf = _ZERO
    q = vec.add(center, vec.scale(normal, radius))
    d = vec.sub(q, p)
    far2 = vec.dot(d, d)
    if not far2 > _ZERO:
        return _nothing()
    w = vec.scale(d, _ONE / math.sqrt(far2))
    cosine = -vec.dot(normal, w)
    if not cone:
        if cosine == _ZERO:
            return _nothing()
        pdf = far2 * _INV_4PI / (abs(cosine) * radius * radius)
    uv = sphere_uv(normal)
    radiance = _emitted(scene, np.uint32(scene.sphere_material[number]), uv, uv, _ONE, cone or cosine > _ZERO)
    error = _ERROR * (max(abs(center[0]), max(abs(center[1]), abs(center[2]))) + radius)
    return LightSample(w, leave(q, error, normal, vec.neg(w)), radiance, pdf, False)


@device
def choose_light(scene, p, n, choice):
    """One of the lights but the environment: (its number, the chance of it); chance 0 where none lights p."""
    if scene.has.lights is not None and len(scene.light_node) > 0:
        return choose_from_tree(scene.light_node, p, n, choice)
    light, _, chance = choose(scene.light_cdf, choice)
    return light, chance


@device
def sample_one_light(scene, light, p, u):
    """Towards p from the light of that number: a LightSample, its pdf without the choice of the light."""
    primitive = np.uint32(scene.light_primitive[light])
    triangles = len(scene.triangle)
    if primitive < triangles:
        return _sample_triangle(scene, primitive, scene.light_area[light], p, u)
    if primitive < triangles + len(scene.sphere):
        return _sample_sphere(scene, primitive - triangles, p, u)
    if scene.has.lights is None:
        return _nothing()
    number = primitive - triangles - len(scene.sphere)
    w, end, radiance, density = sample_punctual(scene.punctual_kind, scene.punctual, number, p, u)
    return LightSample(w, end, radiance, density, True)


@device
def sample_light(scene, p, n, choice, u):
    """Light towards the point p with normal n: a LightSample. `choice` picks the light, u the place on it.

    n is zero where the point is lit from all sides."""
    environment_chance = scene.environment_frame[3]
    if choice < environment_chance:
        choice /= environment_chance
        w, pdf = sample_environment(scene, choice, u)
        radiance = environment_radiance(scene.environment, scene.environment_frame, w)
        return LightSample(w, vec.add(p, vec.scale(w, _FAR)), radiance, pdf * environment_chance, False)
    if len(scene.light_primitive) == 0:
        return _nothing()
    if environment_chance > _ZERO:
        choice = (choice - environment_chance) / (_ONE - environment_chance)
    light, chance = choose_light(scene, p, n, choice)
    if chance == _ZERO:
        return _nothing()
    sample = sample_one_light(scene, light, p, u)
    pdf = sample.pdf * (_ONE - environment_chance) * chance
    return LightSample(sample.direction, sample.end, sample.radiance, pdf, sample.alone)


@device
def environment_seen(scene, w, judged):
    """(radiance from the environment's direction w, the density with which `sample_light` gives w, per steradian: 0 unless
    `judged`)."""
    chance = scene.environment_frame[3]
    radiance, pdf = environment_light(scene, w, judged and chance > _ZERO)
    return radiance, chance * pdf


@device
def primitive_light_pdf(scene, light, p, n, hit, cosine):
    """The density with which `sample_light` gives the point `hit` of a light at p with normal n, per steradian.

    cosine: under which p sees the light's surface."""
    if scene.has.lights is not None and len(scene.light_node) > 0:
        chance = tree_chance(scene.light_node, p, n, light)
    else:
        chance = scene.light_cdf[light + 1] - scene.light_cdf[light]
    chance *= _ONE - scene.environment_frame[3]
    primitive = scene.light_primitive[light]
    triangles = len(scene.triangle)
    d = vec.sub(hit, p)
    square = vec.dot(d, d)
    if primitive < triangles:
        return chance * square / max(cosine * scene.light_area[light], np.float32(1e-30))
    number = primitive - triangles
    center = (scene.sphere[number, 0], scene.sphere[number, 1], scene.sphere[number, 2])
    radius = scene.sphere[number, 3]
    to_center = vec.sub(center, p)
    center2 = vec.dot(to_center, to_center)
    if center2 > _CLOSE * radius * radius:
        return chance * square_to_cone_pdf(_cone(center2, radius))
    return chance * square * _INV_4PI / max(cosine * radius * radius, np.float32(1e-30))
