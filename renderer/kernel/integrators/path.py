"""The path tracer: unidirectional paths with next-event estimation, multiple importance sampling, and Russian roulette."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import UNLIT
from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import local_floats, template
from renderer.kernel import vec
from renderer.kernel.integrators.mixture import mixture_bounce
from renderer.kernel.integrators.record import DIRECT, EMITTED, MISSED, record_light, record_vertex
from renderer.kernel.integrators.strategy import heuristic_weight, mistaken, power_heuristic, share_of_light, special_bounce
from renderer.kernel.integrators.transport import forget_first_hit, keep_first_hit, limited, one_color, reach
from renderer.kernel.integrators.visibility import MAX_PASSED, transmittance
from renderer.kernel.light.environment import environment_radiance
from renderer.kernel.light.lights import environment_light_pdf, primitive_light_pdf, sample_light
from renderer.kernel.material.material import (
    LAYER_SLOTS,
    emission,
    eval_material,
    fetch_material,
    is_specular,
    sample_material,
    transmits,
)
from renderer.kernel.options import LIGHT, MIS, MIXTURE, NO_MISTAKE
from renderer.kernel.sampling.sampler import uniform4
from renderer.kernel.surface.normal_map import shading_frame
from renderer.kernel.surface.surface import departure, surface_at
from renderer.settings import MAX_FLOOR

__all__ = ["trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_ROULETTE_FROM = 4  # segments that every path may have; dark ones end soon after
_MOST_SURVIVAL = np.float32(MAX_FLOOR)


@template
def trace_path(scene, stack, o, d, options, pixel, sample, log, first, special):
    """The path of one sample of one pixel, from the ray o + t d on, d unit: (radiance, number of rays).

    first: (FIRST_HIT_SLOTS,), filled with what `first_hit` of transport.py reads.
    options: renderer.kernel.options.Options; log: rows for record.py, none in pictures. special: None compiles
    the path tracer for pictures, which leaves out what `is_special` settings ask for; else all is in.
    """
    radiance = _BLACK
    throughput = _WHITE
    forget_first_hit(first)
    rays = 0
    segment = 0  # those that end at a vertex
    passed = 0  # surfaces without effect, by their alpha
    point = o  # the last vertex,
    normal = _BLACK  # the side that it is lit from (its shading normal; zero: both),
    pdf = _ZERO  # and the density with which its BSDF gave d; 0 after the camera and after specular bounces
    unscaled = _ONE  # eta**2 of the medium the path is in
    lit = scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0
    if special is not None and options.sampling != MIS and options.sampling != LIGHT:
        lit = len(scene.punctual_kind) > 0
    layers = local_floats(LAYER_SLOTS)  # the rarer materials' textures, looked up
    while True:
        # Wanted further down only; but since they wait for nothing, the processor makes them while the ray is traced.
        r = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(2 * segment + 2))
        for_light = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(2 * segment + 1))
        hit = closest_hit(scene.bvh, stack, o, d, _INF)
        rays += 1
        row = segment + passed
        if hit.primitive == NO_PRIMITIVE:
            if row < len(log):
                record_vertex(log, row, MISSED, 0, 0, hit.t, pdf, o, d, d, throughput, radiance)
            if pdf >= _ZERO:
                emitted = environment_radiance(scene.environment, scene.environment_frame, d)
                weight = _ONE
                if pdf > _ZERO:
                    light_pdf = environment_light_pdf(scene, d)
                    if special is None:
                        weight = power_heuristic(pdf, light_pdf)
                    else:
                        weight = heuristic_weight(options.heuristic, pdf, light_pdf)
                radiance = vec.add(radiance, limited(vec.mul(throughput, vec.scale(emitted, weight)), segment + 1, options.clamp))
            if row < len(log):
                record_light(log, row, EMITTED, radiance)
            break
        surface = surface_at(scene, o, d, hit)
        through, throughput = reach(scene, surface, hit.t, d, point, options, pixel, sample, row, pdf, throughput, radiance, log)
        if through:
            passed += 1
            if passed == MAX_PASSED:
                break
            o = departure(surface, False, d)
            continue
        wo_world = vec.neg(d)
        if surface.light >= 0 and pdf >= _ZERO:
            emitted = emission(scene, surface.material, surface.uv, surface.uv1, surface.front)
            weight = _ONE
            if pdf > _ZERO:
                cosine = vec.dot(surface.geometric, wo_world)
                light_pdf = primitive_light_pdf(scene, surface.light, point, normal, surface.point, cosine)
                if special is None:
                    weight = power_heuristic(pdf, light_pdf)
                else:
                    weight = heuristic_weight(options.heuristic, pdf, light_pdf)
            if special is not None and options.mistake != NO_MISTAKE and segment > 0:
                weight *= mistaken(options.mistake, point, surface.point)
            radiance = vec.add(radiance, limited(vec.mul(throughput, vec.scale(emitted, weight)), segment + 1, options.clamp))
        frame = shading_frame(scene, surface, wo_world)
        material = fetch_material(scene, surface, frame, layers)
        material, throughput = one_color(scene, surface, material, throughput, options, pixel, sample, np.uint32(segment))
        if segment == 0:
            depth = hit.t if passed == 0 else vec.length(vec.sub(surface.point, point))
            keep_first_hit(first, surface, material.base, frame[2], depth)
        if material.kind == UNLIT:
            radiance = vec.add(radiance, limited(vec.mul(throughput, material.base), segment + 1, options.clamp))
        if row < len(log):
            record_light(log, row, EMITTED, radiance)
        if segment + 1 == options.max_depth or material.kind == UNLIT:
            break

        s, q, n = frame
        wo = vec.to_local(s, q, n, wo_world)
        specular = is_specular(material)
        normal = _BLACK if transmits(material) else n
        if lit and not specular:
            count = 1
            if special is not None and segment == 0:
                count = options.light_samples
            for k in range(count):
                if special is not None and count > 1:
                    number = np.uint32(sample * np.uint32(count) + np.uint32(k))
                    for_light = uniform4(options.sampler, options.seed, pixel, number, np.uint32(2 * segment + 1))
                light = sample_light(scene, surface.point, normal, for_light[2], (for_light[0], for_light[1]))
                if light.pdf > _ZERO and vec.maximum(light.radiance) > _ZERO:
                    wi = vec.to_local(s, q, n, light.direction)
                    f, scatter_pdf = eval_material(material, wo, wi)
                    if vec.maximum(f) > _ZERO:
                        start = departure(surface, wi[2] > _ZERO, light.direction)
                        rays += 1
                        weight = transmittance(scene, stack, start, light.end, options.transparent) / light.pdf
                        if weight > _ZERO:
                            if special is None:
                                weight *= _ONE if light.alone else power_heuristic(light.pdf, scatter_pdf)
                            else:
                                share = share_of_light(options, light.pdf, scatter_pdf, light.alone)
                                weight *= share / np.float32(count)
                                if options.mistake != NO_MISTAKE:
                                    weight *= mistaken(options.mistake, surface.point, light.end)
                            arriving = vec.scale(vec.mul(f, light.radiance), weight)
                            radiance = vec.add(radiance, limited(vec.mul(throughput, arriving), segment + 2, options.clamp))
            if row < len(log):
                record_light(log, row, DIRECT, radiance)

        if special is None:
            wi, weight, pdf, thinned = sample_material(material, wo, r[2], (r[0], r[1]))
        elif options.sampling == MIXTURE and not specular:
            wi, weight, pdf, thinned = mixture_bounce(scene, surface.point, frame, material, wo, r[2], (r[0], r[1]))
        else:
            wi, weight, pdf, thinned = special_bounce(material, options.sampling, wo, r[2], (r[0], r[1]))
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
            survival = min(max(vec.maximum(throughput) * unscaled, options.roulette_floor), _MOST_SURVIVAL)
            if r[3] >= survival:
                break
            throughput = vec.scale(throughput, _ONE / survival)
        point = surface.point
        o = departure(surface, wi[2] > _ZERO, d)
        segment += 1
    return radiance, rays
