"""The path tracer: unidirectional paths with next-event estimation, MIS by the power heuristic, and Russian roulette."""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import device, local_floats, subroutine
from renderer.kernel import vec
from renderer.kernel.environment import environment_radiance
from renderer.kernel.light import environment_light_pdf, primitive_light_pdf, sample_light
from renderer.kernel.material import LAYER_SLOTS, emission, eval_material, fetch_material, is_specular, sample_material
from renderer.kernel.mixture import mixture_bounce
from renderer.kernel.normal_map import shading_frame
from renderer.kernel.options import LIGHT, MIS, MIXTURE, NO_MISTAKE, UNIFORM
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.record import DIRECT, EMITTED, MISSED, PASSED, SURFACE, record_light, record_vertex
from renderer.kernel.rows import UNLIT
from renderer.kernel.sampler import uniform4
from renderer.kernel.surface import departure, surface_at
from renderer.kernel.transport import PathResult, attenuated, is_passed, limited, mistaken, transmits
from renderer.kernel.visibility import MAX_PASSED, transmittance
from renderer.kernel.warp import square_to_sphere

__all__ = ["power_heuristic", "trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INF = np.float32(np.inf)
_HALF = np.float32(0.5)
_EIGHT_PI = np.float32(8.0 * math.pi)
_TWO_PI = np.float32(2.0 * math.pi)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_ROULETTE_FROM = 4  # segments that every path may have; dark ones end soon after
_INDIRECT = 3  # segments from which on light counts as indirect
_LEAST_PDF, _MOST_PDF = np.float32(1e-18), np.float32(1e18)  # whose squares float32 still holds
_MOST_SURVIVAL = np.float32(0.95)
_LEFT_TO_LIGHTS = np.float32(-1.0)  # in a density's place: light sampling alone counts what the direction meets


@device
def power_heuristic(a, b):
    """The weight of a sample whose own density is a and the other strategy's b (Veach 1997): with b's, they sum to 1.

    a > 0."""
    a = min(max(a, _LEAST_PDF), _MOST_PDF)
    b = min(b, _MOST_PDF)
    return a * a / (a * a + b * b)


@subroutine
def _uniform_bounce(material, wo, choose, u):
    """A direction that does not ask what the material does with it: as `sample_material`, but for the density, which is 0.

    Uniform over the hemisphere; over the sphere where light may pass. Single directions, which no such sample would find, are
    then taken from the material by the toss of a coin.
    """
    both = transmits(material)
    if both:
        if choose < _HALF:
            wi, weight, pdf, thinned = sample_material(material, wo, _TWO * choose, u)
            return wi, vec.scale(weight, _TWO if pdf == _ZERO else _ZERO), _ZERO, thinned
        wi = square_to_sphere(u)
    else:
        radius = math.sqrt(u[0] * (_TWO - u[0]))
        sine, cosine = sincos_turns(u[1])
        wi = (radius * cosine, radius * sine, _ONE - u[0])
    f, _ = eval_material(material, wo, wi)
    return wi, vec.scale(f, _EIGHT_PI if both else _TWO_PI), _ZERO, _ONE


@device
def trace_path(scene, stack, o, d, options, pixel, sample, log):
    """The path of one sample of one pixel, from the ray o + t d on, d unit: a PathResult.

    options: renderer.kernel.options.Options; log: rows for renderer.kernel.record, none in pictures.
    """
    radiance = _BLACK
    throughput = _WHITE
    albedo = _BLACK
    first_normal = _BLACK
    position = _BLACK
    depth = _ZERO
    object_id = material_id = 0
    rays = 0
    segment = 0  # those that end at a vertex
    passed = 0  # surfaces without effect, by their alpha
    distance = _ZERO  # from the last vertex to the last of these
    point = o  # the last vertex,
    normal = _BLACK  # the side that it is lit from (its shading normal; zero: both),
    pdf = _ZERO  # and the density with which its BSDF gave d; 0 after the camera and after specular bounces
    unscaled = _ONE  # eta**2 of the medium the path is in
    sampled = options.sampling == MIS or options.sampling == LIGHT
    lit = (sampled and scene.environment_frame[3] > _ZERO) or len(scene.light_primitive if sampled else scene.punctual_kind) > 0
    layers = local_floats(LAYER_SLOTS)  # the rarer materials' textures, looked up
    while True:
        hit = closest_hit(scene.bvh, stack, o, d, _INF)
        rays += 1
        row = segment + passed
        limit = options.clamp if segment + 1 >= _INDIRECT else _ZERO
        if hit.primitive == NO_PRIMITIVE:
            if row < len(log):
                record_vertex(log, row, MISSED, 0, 0, hit.t, pdf, o, d, d, throughput, radiance)
            if pdf >= _ZERO:
                emitted = environment_radiance(scene.environment, scene.environment_frame, d)
                weight = power_heuristic(pdf, environment_light_pdf(scene, d)) if pdf > _ZERO else _ONE
                radiance = vec.add(radiance, limited(vec.mul(throughput, vec.scale(emitted, weight)), limit))
            if row < len(log):
                record_light(log, row, EMITTED, radiance)
            break
        surface = surface_at(scene, o, d, hit)
        distance += hit.t
        if options.transparent and is_passed(scene, surface, options, pixel, sample, passed):
            if row < len(log):
                record_vertex(
                    log, row, PASSED, 1 + surface.object, 1 + surface.material, hit.t, pdf, surface.point, surface.shading, d,
                    throughput, radiance,
                )  # fmt: skip
            passed += 1
            if passed == MAX_PASSED:
                break
            o = departure(surface, False)
            continue
        if not surface.front:
            throughput = attenuated(scene, surface.material, throughput, distance)
        if row < len(log):
            record_vertex(
                log, row, SURFACE, 1 + surface.object, 1 + surface.material, distance, pdf, surface.point, surface.shading, d,
                throughput, radiance,
            )  # fmt: skip
        wo_world = vec.neg(d)
        if surface.light >= 0 and pdf >= _ZERO:
            emitted = emission(scene, surface.material, surface.uv, surface.uv1, surface.front)
            weight = _ONE
            if pdf > _ZERO:
                cosine = vec.dot(surface.geometric, wo_world)
                weight = power_heuristic(pdf, primitive_light_pdf(scene, surface.light, point, normal, surface.point, cosine))
            if options.mistake != NO_MISTAKE and segment > 0:
                weight *= mistaken(options.mistake, distance * distance)
            radiance = vec.add(radiance, limited(vec.mul(throughput, vec.scale(emitted, weight)), limit))
        frame = shading_frame(scene, surface, wo_world)
        material = fetch_material(scene, surface, frame, layers)
        if segment == 0:
            albedo = material.base
            first_normal = frame[2]
            position = surface.point
            depth = distance
            object_id = 1 + surface.object
            material_id = 1 + surface.material
        if material.kind == UNLIT:
            radiance = vec.add(radiance, limited(vec.mul(throughput, material.base), limit))
        if row < len(log):
            record_light(log, row, EMITTED, radiance)
        if segment + 1 == options.max_depth or material.kind == UNLIT:
            break

        s, q, n = frame
        wo = vec.to_local(s, q, n, wo_world)
        specular = is_specular(material)
        normal = _BLACK if transmits(material) else n
        if lit and not specular:
            count = options.light_samples if segment == 0 else 1
            share = _ONE / np.float32(count)
            limit = options.clamp if segment + 2 >= _INDIRECT else _ZERO
            for k in range(count):
                number = np.uint32(sample * np.uint32(count) + np.uint32(k))
                r = uniform4(options.sampler, options.seed, pixel, number, np.uint32(2 * segment + 1))
                light = sample_light(scene, surface.point, normal, r[2], (r[0], r[1]))
                if light.pdf > _ZERO and vec.maximum(light.radiance) > _ZERO and (sampled or light.alone):
                    wi = vec.to_local(s, q, n, light.direction)
                    f, scatter_pdf = eval_material(material, wo, wi)
                    if vec.maximum(f) > _ZERO:
                        start = departure(surface, wi[2] > _ZERO)
                        rays += 1
                        visible = transmittance(scene, stack, start, light.end, options.transparent)
                        if visible > _ZERO:
                            weighed = options.sampling == MIS and not light.alone
                            balance = power_heuristic(light.pdf, scatter_pdf) if weighed else _ONE
                            weight = visible * balance * share / light.pdf
                            if options.mistake != NO_MISTAKE:
                                way = vec.sub(light.end, surface.point)
                                weight *= mistaken(options.mistake, vec.dot(way, way))
                            arriving = vec.scale(vec.mul(f, light.radiance), weight)
                            radiance = vec.add(radiance, limited(vec.mul(throughput, arriving), limit))
            if row < len(log):
                record_light(log, row, DIRECT, radiance)

        r = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(2 * segment + 2))
        if options.sampling == UNIFORM and not specular:
            wi, weight, pdf, thinned = _uniform_bounce(material, wo, r[2], (r[0], r[1]))
        elif options.sampling == MIXTURE and not specular:
            wi, weight, pdf, thinned = mixture_bounce(scene, surface.point, s, q, n, material, wo, r[2], (r[0], r[1]))
        else:
            wi, weight, pdf, thinned = sample_material(material, wo, r[2], (r[0], r[1]))
        if pdf > _ZERO and options.sampling != MIS:
            pdf = _LEFT_TO_LIGHTS if options.sampling == LIGHT else _ZERO
        throughput = vec.mul(throughput, weight)
        unscaled *= thinned
        d = vec.to_world(s, q, n, wi)
        if vec.maximum(throughput) <= _ZERO:
            break
        if options.roulette > _ZERO:
            if r[3] >= options.roulette:
                break
            throughput = vec.scale(throughput, _ONE / options.roulette)
        elif segment + 1 >= _ROULETTE_FROM:
            survival = min(vec.maximum(throughput) * unscaled, _MOST_SURVIVAL)
            if r[3] >= survival:
                break
            throughput = vec.scale(throughput, _ONE / survival)
        point = surface.point
        distance = _ZERO
        o = departure(surface, wi[2] > _ZERO)
        segment += 1
    return PathResult(radiance, albedo, first_normal, depth, position, object_id, material_id, rays)
