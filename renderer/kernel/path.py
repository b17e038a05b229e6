"""The path tracer: unidirectional paths with next-event estimation, MIS by the power heuristic, and Russian roulette."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import device, local_floats
from renderer.kernel import vec
from renderer.kernel.environment import environment_radiance
from renderer.kernel.light import environment_light_pdf, primitive_light_pdf, sample_light
from renderer.kernel.material import LAYER_SLOTS, emission, eval_material, fetch_material, is_specular, sample_material
from renderer.kernel.normal_map import shading_frame
from renderer.kernel.sampler import uniform4
from renderer.kernel.surface import leave, surface_at
from renderer.kernel.visibility import transmittance

__all__ = ["PathResult", "power_heuristic", "trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_ROULETTE_FROM = 4  # segments that every path may have; dark ones end soon after
_LEAST_PDF, _MOST_PDF = np.float32(1e-18), np.float32(1e18)  # whose squares float32 still holds
_MOST_SURVIVAL = np.float32(0.95)


class PathResult(NamedTuple):
    """What one path brought home: float32, colours in linear Rec.709."""

    radiance: tuple[float, float, float]
    albedo: tuple[float, float, float]  # of the first hit; 0 where nothing is hit
    normal: tuple[float, float, float]  # its shading normal, on the viewer's side
    depth: float  # its distance
    position: tuple[float, float, float]
    object: int  # 1 + its number; 0 where nothing is hit
    material: int  # likewise
    rays: int


@device
def power_heuristic(a, b):
    """The weight of a sample whose own density is a and the other strategy's b (Veach 1997): with b's, they sum to 1.

    a > 0."""
    a = min(max(a, _LEAST_PDF), _MOST_PDF)
    b = min(b, _MOST_PDF)
    return a * a / (a * a + b * b)


@device
def trace_path(scene, stack, o, d, options, pixel, sample):
    """The path of one sample of one pixel, from the ray o + t d on. A PathResult. options: renderer.kernel.options.Options."""
    radiance = _BLACK
    throughput = _WHITE
    albedo = _BLACK
    first_normal = _BLACK
    position = _BLACK
    depth = _ZERO
    object_id = material_id = 0
    rays = 0
    point = o  # the last vertex,
    normal = _BLACK  # its shading normal,
    pdf = _ZERO  # and the density with which its BSDF gave d; 0 after the camera and after specular bounces
    unscaled = _ONE  # eta**2 of the medium the path is in
    lit = scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0
    layers = local_floats(LAYER_SLOTS)  # the rarer materials' textures, looked up
    for segment in range(options.max_depth):
        hit = closest_hit(scene.bvh, stack, o, d, _INF)
        rays += 1
        if hit.primitive == NO_PRIMITIVE:
            emitted = environment_radiance(scene.environment, scene.environment_frame, d)
            weight = power_heuristic(pdf, environment_light_pdf(scene, d)) if pdf > _ZERO else _ONE
            radiance = vec.add(radiance, vec.mul(throughput, vec.scale(emitted, weight)))
            break
        surface = surface_at(scene, o, d, hit)
        wo_world = vec.neg(d)
        if surface.light >= 0:
            emitted = emission(scene, surface.material, surface.uv, surface.uv1, surface.front)
            weight = _ONE
            if pdf > _ZERO:
                cosine = vec.dot(surface.geometric, wo_world)
                weight = power_heuristic(pdf, primitive_light_pdf(scene, surface.light, point, normal, surface.point, cosine))
            radiance = vec.add(radiance, vec.mul(throughput, vec.scale(emitted, weight)))
        frame = shading_frame(scene, surface, wo_world)
        material = fetch_material(scene, surface, frame, layers)
        if segment == 0:
            albedo = material.base
            first_normal = frame[2]
            position = surface.point
            depth = hit.t
            object_id = 1 + surface.object
            material_id = 1 + surface.material
        if segment + 1 == options.max_depth:
            break

        r0 = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(2 * segment + 1))
        r1 = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(2 * segment + 2))
        s, q, n = frame
        wo = vec.to_local(s, q, n, wo_world)
        if lit and not is_specular(material):
            light = sample_light(scene, surface.point, surface.shading, r0[2], (r0[0], r0[1]))
            facing = vec.dot(light.direction, surface.geometric)
            if light.pdf > _ZERO and facing > _ZERO and vec.maximum(light.radiance) > _ZERO:
                f, scatter_pdf = eval_material(material, wo, vec.to_local(s, q, n, light.direction))
                if vec.maximum(f) > _ZERO:
                    start = leave(surface.point, surface.error, surface.geometric, light.direction)
                    rays += 1
                    visible = transmittance(scene, stack, start, light.end)
                    if visible > _ZERO:
                        balance = _ONE if light.alone else power_heuristic(light.pdf, scatter_pdf)
                        weight = visible * balance / light.pdf
                        arriving = vec.scale(vec.mul(f, light.radiance), weight)
                        radiance = vec.add(radiance, vec.mul(throughput, arriving))

        wi, weight, pdf, thinned = sample_material(material, wo, r1[2], (r1[0], r1[1]))
        throughput = vec.mul(throughput, weight)
        unscaled *= thinned
        d = vec.to_world(s, q, n, wi)
        # A bent shading normal may send light through the surface, or back from behind it: neither exists.
        if vec.maximum(throughput) <= _ZERO or (vec.dot(d, surface.geometric) > _ZERO) != (wi[2] > _ZERO):
            break
        if segment + 1 >= _ROULETTE_FROM:
            survival = min(vec.maximum(throughput) * unscaled, _MOST_SURVIVAL)
            if r0[3] >= survival:
                break
            throughput = vec.scale(throughput, _ONE / survival)
        point = surface.point
        normal = n
        o = leave(surface.point, surface.error, surface.geometric, d)
    return PathResult(radiance, albedo, first_normal, depth, position, object_id, material_id, rays)
