"""Light sampling: chooses a light, then a point on it or a direction.

The environment is chosen with a fixed probability; other lights by power if they are few, by a light tree if they are many.
Triangles are sampled uniformly by area and environments by radiance; spheres, parallelograms and punctual lights have separate
modules.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.light_rows import CORNER_ERROR, PARALLELOGRAM
from renderer.arrays.rows import PART_COLUMNS, PART_MATERIAL, TEXTURED
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns, row
from renderer.kernel.light.emission_map import emission_towards, moving_emission_towards
from renderer.kernel.light.environment import environment_light, environment_radiance, sample_cdf, sample_environment
from renderer.kernel.light.light_sample import LightSample, emitted, empty_light_sample, if_found, select_light_sample
from renderer.kernel.light.light_tree import sample_light_tree, tree_probability
from renderer.kernel.light.parallelogram import parallelogram_pdf, sample_parallelogram
from renderer.kernel.light.punctual import SUN, SUN_UNSEEN, moving_sun, sample_moving_punctual, sample_punctual
from renderer.kernel.light.sphere_light import faces_viewer, sample_facing, sample_sphere, sphere_light_pdf
from renderer.kernel.sampling.warp import square_to_cone_pdf, square_to_triangle
from renderer.kernel.surface.ray_origins import leave
from renderer.kernel.surface.surface import moving_triangle_point, triangle_point, triangle_uv
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, as_wide3, lookup, not_, u32, where, where3, zero_like

__all__ = [
    "FAR",
    "choose_by_power",
    "choose_light",
    "choose_sampled",
    "environment_seen",
    "nearby_choice",
    "primitive_light_pdf",
    "sample_chosen",
    "sample_light",
    "sample_one_light",
    "sun_seen",
]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
FAR = np.float32(1e18)  # distance of the environment
_LEAST = np.float32(1e-30)
_FIRST = np.uint32(0)
_NEXT = np.uint32(1)
_SUN = np.uint32(SUN)
_TEXTURED = np.uint32(TEXTURED)


@device
def _vertex_alpha(scene, number, b, c):
    i, j, k, _ = row(scene.triangle, number, 4)
    return (_ONE - b - c) * row(scene.color, i, 4)[3] + b * row(scene.color, j, 4)[3] + c * row(scene.color, k, 4)[3]


@device
def _sample_triangle(scene, number, area, p, u, time):
    """Samples a point uniformly on a triangle light, seen from the world point p.

    Returns a LightSample whose pdf (per steradian) excludes the probability of choosing the light.
    """
    b, c = square_to_triangle(u)
    q, error, normal = triangle_point(scene.position, scene.triangle, number, b, c)
    if time is not None and len(scene.key_position) > 0:
        q, error, normal = each_lane(moving_triangle_point, b == b, (scene, number, b, c, time))
        area = max(_HALF * vec.length(normal), _LEAST)
    d = vec.sub(q, p)
    square = vec.dot(d, d)
    w = vec.scale(d, _ONE / math.sqrt(square))
    projected = -vec.dot(normal, w)  # twice the area, seen from p
    part = row(scene.triangle, number, 4)[3]
    material = u32(row(scene.part, part, PART_COLUMNS)[PART_MATERIAL])
    uv = uv1 = zero_like(b), zero_like(b)
    alpha = as_wide(_ONE, b)
    if scene.has.textures is not None:
        if any_of(u32(lookup(scene.material_flags, material)) & _TEXTURED != _FIRST):
            uv = triangle_uv(scene.uv, scene.triangle, number, b, c)
        uv1 = triangle_uv(scene.uv1, scene.triangle, number, b, c) if len(scene.uv1) > 0 else uv
        alpha = _vertex_alpha(scene, number, b, c) if len(scene.color) > 0 else alpha
    radiance = emitted(scene, material, uv, uv1, alpha, projected > _ZERO, time)
    end = leave(q, error, vec.scale(normal, _HALF / area), vec.neg(w))
    sample = LightSample(w, end, radiance, _TWO * square / abs(projected), as_wide(False, b))
    return if_found((square > _ZERO) & (abs(projected) > _ZERO), sample, p)


@device
def _sample_parallelogram(scene, light, number, area, p, n, u, time):
    """Samples a point on parallelogram `light`; returns a LightSample like that of `_sample_triangle`.

    number: the parallelogram's first triangle. n: the normal at p; see `sample_parallelogram`.
    """
    q, error, normal, density = sample_parallelogram(scene, light, p, n, u)
    d = vec.sub(q, p)
    square = vec.dot(d, d)
    w = vec.scale(d, _ONE / math.sqrt(square))
    projected = -vec.dot(normal, w)  # the area, seen from p
    material = u32(row(scene.part, row(scene.triangle, number, 4)[3], PART_COLUMNS)[PART_MATERIAL])
    uv = zero_like(square), zero_like(square)
    radiance = emitted(scene, material, uv, uv, as_wide(_ONE, square), projected > _ZERO, time)
    end = leave(q, error, vec.scale(normal, _ONE / area), vec.neg(w))
    sample = LightSample(w, end, radiance, density * square / abs(projected), as_wide(False, square))
    return if_found((square > _ZERO) & (abs(projected) > _ZERO) & (density > _ZERO), sample, p)


@device
def choose_light(scene, p, n, choice):
    """Chooses a light other than the environment for point p with normal n; returns (light number, its probability).

    The probability is 0 if no light reaches p. choice: a random number in [0, 1).
    """
    return _choose_light(scene, p, n, choice, as_wide(True, choice))


@device
def _choose_light(scene, p, n, choice, wanted):
    """Chooses lights as `choose_light` does in the lanes where `wanted` is True; those in other lanes are any valid ones."""
    if scene.has.lights is not None and len(scene.light_node) > 0:
        light, chance = each_lane(sample_light_tree, wanted, (scene.light_node, p, n, choice))
        return u32(light), chance
    light, _, chance = sample_cdf(scene.light_cdf, choice)
    return light, chance


@device
def sample_one_light(scene, light, p, n, u, time=None):
    """Samples light number `light` from p; returns a LightSample whose pdf excludes the probability of choosing the light.

    n: the normal at p; zero for light from all sides; None to sample parallelograms uniformly. time: shutter time, 0 ... 1; None
    for a scene without motion.
    """
    primitive = u32(lookup(scene.light_primitive, light))
    beyond = u32(primitive - np.uint32(len(scene.triangle)))  # wraps to a large number for triangles
    is_triangle, is_sphere = primitive < np.uint32(len(scene.triangle)), beyond < np.uint32(len(scene.sphere))
    sample = empty_light_sample(p)
    if any_of(is_triangle):
        area, number = lookup(scene.light_area, light), where(is_triangle, primitive, _FIRST)
        paired = _is_parallelogram(scene, light)
        if any_of(paired):
            sample = if_found(paired, _sample_parallelogram(scene, light, number, area, p, n, u, time), p)
        if any_of(is_triangle & not_(paired)):
            sample = select_light_sample(paired, sample, _sample_triangle(scene, number, area, p, u, time))
    if any_of(is_sphere):
        number = where(is_sphere, beyond, _FIRST)
        facing = is_sphere & faces_viewer(scene, number)
        if any_of(is_sphere & not_(facing)):
            sample = select_light_sample(is_sphere, sample_sphere(scene, number, p, u, time), sample)
        if any_of(facing):
            sample = select_light_sample(facing, sample_facing(scene, number, p, u, time), sample)
    if scene.has.lights is not None:
        alone = not_(is_triangle | is_sphere)
        if any_of(alone):
            number = u32(beyond - np.uint32(len(scene.sphere)))
            w, end, radiance, density = _sample_alone(scene, number, alone, p, u, time)
            met = u32(lookup(scene.punctual_kind, where(alone, number, _FIRST))) >= _SUN
            sample = select_light_sample(alone, LightSample(w, end, radiance, density, alone & not_(met)), sample)
    return sample


@device
def _is_parallelogram(scene, light):
    if len(scene.light_parallelogram) == 0:
        return as_wide(False, light)
    return columns(scene.light_parallelogram, light, PARALLELOGRAM, CORNER_ERROR, 1)[0] > _ZERO


@device
def _sample_alone(scene, number, wanted, p, u, time):
    """Samples the punctual lights `number` in the lanes where `wanted` is True, one lane at a time.

    Returns the tuple of `sample_punctual`. The lights may move and have emission maps.
    """
    if time is not None and len(scene.key_punctual) > 0:
        sample = each_lane(sample_moving_punctual, wanted, (scene.punctual_kind, scene.key_punctual, number, p, u, time))
    else:
        sample = each_lane(sample_punctual, wanted, (scene.punctual_kind, scene.punctual, number, p, u))
    if len(scene.emission_frame) == 0:
        return sample
    w, end, radiance, density = sample
    return w, end, vec.mul(radiance, _emission(scene, number, wanted, p, w, time)), density


@device
def _emission(scene, number, wanted, p, w, time):
    if time is not None and len(scene.key_emission_frame) > 0:
        return each_lane(moving_emission_towards, wanted, (scene, number, p, w, time))
    return each_lane(emission_towards, wanted, (scene, number, p, w))


@device
def nearby_choice(scene, choice):
    """Returns (whether `choice`, in [0, 1), selects a light other than the environment; `choice` rescaled to [0, 1))."""
    environment_chance = scene.environment_frame[3]
    nearby = not_(choice < environment_chance)
    if environment_chance > _ZERO:
        choice = (choice - environment_chance) / (_ONE - environment_chance)
    return nearby, choice


@device
def choose_sampled(scene, p, n, choice):
    """Chooses the light that `sample_light` samples unless `choice` selects the environment; returns (light, its probability)."""
    light, chance = as_wide(_FIRST, choice), zero_like(choice)
    if len(scene.light_primitive) > 0:
        nearby, rest = nearby_choice(scene, choice)
        if any_of(nearby):
            light, chance = _choose_light(scene, p, n, rest, nearby)
    return light, chance


@device
def sample_light(scene, p, n, choice, u, time=None):
    """Samples the direct light at the world point p with normal n; returns a LightSample.

    choice: selects the light. u: selects the point on it. n: zero for light from all sides. time: as for `sample_one_light`.
    """
    light, chance = choose_sampled(scene, p, n, choice)
    return sample_chosen(scene, p, n, choice, u, light, chance, time)


@device
def choose_by_power(scene, choice):
    """Chooses a light as `choose_sampled` does, for scenes without a light tree, in which lights are chosen by power."""
    light, chance = as_wide(_FIRST, choice), zero_like(choice)
    if len(scene.light_primitive) > 0:
        nearby, rest = nearby_choice(scene, choice)
        if any_of(nearby):
            light, _, chance = sample_cdf(scene.light_cdf, rest)
    return light, chance


@device
def sample_chosen(scene, p, n, choice, u, light, chance, time):
    """Samples the environment if `choice` selects it, else the given light; returns a LightSample, see `sample_light`.

    light, chance: number of the light chosen beforehand and its probability; the probability is 0 if there is none.
    """
    environment_chance = scene.environment_frame[3]
    from_far = choice < environment_chance
    nearby = not_(from_far)
    sample = empty_light_sample(p)
    if any_of(from_far):
        w, pdf = sample_environment(scene, choice / environment_chance, u)
        radiance = environment_radiance(scene.environment, scene.environment_frame, w)
        end = vec.add(p, vec.scale(w, FAR))
        sample = LightSample(w, end, radiance, pdf * environment_chance, as_wide(False, choice))
    if any_of(nearby):
        sample = select_light_sample(nearby, _sample_nearby(scene, p, n, u, light, chance, nearby, time), sample)
    return sample


@device
def _sample_nearby(scene, p, n, u, light, chance, wanted, time):
    """Samples the given light for `sample_chosen`, in the lanes where `wanted` is True.

    The pdf includes the probability of choosing the light.
    """
    sample = empty_light_sample(p)
    if len(scene.light_primitive) > 0 and any_of(wanted & (chance != _ZERO)):
        found = sample_one_light(scene, light, p, n, u, time)
        pdf = found.pdf * (_ONE - scene.environment_frame[3]) * chance
        sample = LightSample(found.direction, found.end, found.radiance, pdf, found.alone)
        sample = if_found(chance != _ZERO, sample, p)
    return sample


@device
def environment_seen(scene, w, judged):
    """Returns (environment radiance from world direction w, pdf of w under `sample_light` per steradian).

    judged: whether the pdf is needed; it is 0 otherwise.
    """
    chance = scene.environment_frame[3]
    radiance, pdf = environment_light(scene, w, judged & (chance > _ZERO))
    return radiance, chance * pdf


@device
def sun_seen(scene, which, p, n, w, judged, by_camera, time=None):
    """Returns (radiance of one sun from direction w, pdf of w under `sample_light` per steradian).

    which: index in scene.sun. p, n: the shaded point and its normal. judged: whether the pdf is needed; it is 0 otherwise.
    by_camera: whether the ray starts at the camera, which does not see suns of kind SUN_UNSEEN.
    """
    light = np.uint32(scene.sun[which])
    number = np.int64(scene.light_primitive[light]) - len(scene.triangle) - len(scene.sphere)
    told = row(scene.punctual, number, 12)
    place, value, extent = as_wide3(told[0:3], w[0]), as_wide3(told[6:9], w[0]), as_wide(told[9], w[0])
    if time is not None and len(scene.key_punctual) > 0:
        place, value, extent = each_lane(moving_sun, w[0] == w[0], (scene.punctual_kind, scene.key_punctual, number, time))
    away = vec.sub(w, place)  # squared chord, since a float32 cosine has an error of a hundredth of the disk
    on_disk = vec.dot(away, away) < _TWO * extent
    if scene.punctual_kind[number] == SUN_UNSEEN:
        on_disk = on_disk & not_(by_camera)
    radiance, pdf = (zero_like(w[0]), zero_like(w[0]), zero_like(w[0])), zero_like(w[0])
    if any_of(on_disk):
        radiance = where3(on_disk, value, radiance)
        judged = judged & on_disk
        if len(scene.light_node) > 0:
            chance = each_lane(tree_probability, judged, (scene.light_node, p, n, as_wide(light, w[0])))
        else:
            chance = as_wide(scene.light_cdf[light + _NEXT] - scene.light_cdf[light], w[0])
        pdf = where(judged, chance * (_ONE - scene.environment_frame[3]) * square_to_cone_pdf(extent), pdf)
    return radiance, pdf


@device
def primitive_light_pdf(scene, light, p, n, hit, cosine, judged, time=None):
    """Returns the pdf, per steradian, with which `sample_light` samples the point `hit` of a light from p with normal n.

    cosine: of the angle between the ray and the light's normal. judged: whether the pdf is needed; it is 0 otherwise. time:
    shutter time, 0 ... 1; None for a scene without motion.
    """
    if scene.has.lights is not None and len(scene.light_node) > 0:
        chance = each_lane(tree_probability, judged, (scene.light_node, p, n, light))
    else:
        chance = lookup(scene.light_cdf, u32(light + _NEXT)) - lookup(scene.light_cdf, light)
    chance = chance * (_ONE - scene.environment_frame[3])
    primitive = u32(lookup(scene.light_primitive, light))
    triangles = np.uint32(len(scene.triangle))
    is_triangle = primitive < triangles
    d = vec.sub(hit, p)
    square = vec.dot(d, d)
    pdf = zero_like(cosine)
    if any_of(is_triangle):
        area = _area(scene, light, primitive, is_triangle, time)
        pdf = chance * square / max(cosine * area, _LEAST)
        if len(scene.light_parallelogram) > 0:
            pdf = pdf * parallelogram_pdf(scene, light, p, n, hit)
    beyond = u32(primitive - triangles)
    is_sphere = beyond < np.uint32(len(scene.sphere))  # a lane that is not judged may hold a punctual light
    if any_of(is_sphere):
        number = where(is_sphere, beyond, _FIRST)
        pdf = where(is_sphere, sphere_light_pdf(scene, number, p, square, cosine, chance, time), pdf)
    return where(judged, pdf, _ZERO)


@device
def _area(scene, light, primitive, is_triangle, time):
    """Returns the area of a triangle or parallelogram light at the shutter time; undefined for other lights."""
    area = lookup(scene.light_area, light)
    if time is not None and len(scene.key_position) > 0:
        paired = _is_parallelogram(scene, light)  # does not move; its area is twice that of its first triangle
        area = where(paired, area, each_lane(_moving_area, is_triangle & not_(paired), (scene, primitive, time)))
    return area


@subroutine
def _moving_area(scene, number, time):
    return _HALF * vec.length(moving_triangle_point(scene, number, _ZERO, _ZERO, time)[2])
