"""The path tracer that follows one path at a time: the steps of renderer/kernel/steps in order.

Unidirectional paths with next-event estimation, multiple importance sampling, and Russian roulette, after Veach, "Robust Monte
Carlo Methods for Light Transport Simulation" (1997); pbrt 4ed, 13.4 has the same steps. Frames are rendered by
renderer/kernel/backends/cpu, which computes the same samples to the bit.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import MEDIUM, UNLIT
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit
from renderer.jit import device, local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import store_first_hit
from renderer.kernel.backends.scalar.vertex import LAYER_SLOTS, arrive, enter_subsurface, medium_vertex, surface_vertex
from renderer.kernel.backends.scalar.visibility import left_between
from renderer.kernel.light.lights import sample_light
from renderer.kernel.material.material import eval_material, is_specular
from renderer.kernel.path_trace import (
    DIRECT,
    EMITTED,
    record_beside,
    record_light,
    record_medium,
    record_miss,
    record_surface,
)
from renderer.kernel.sampling.sampler import substream
from renderer.kernel.steps.continue_or_end import continue_or_end, is_last
from renderer.kernel.steps.emitted_light import add_light, emitted_by_environment, emitted_by_sun, emitted_light
from renderer.kernel.steps.medium_event import medium_event
from renderer.kernel.steps.mis import branches_to_light
from renderer.kernel.steps.pass_through import counts_emission, pass_through
from renderer.kernel.steps.random_blocks import draw_light, draw_scattering
from renderer.kernel.steps.record_first_hit import record_first_hit
from renderer.kernel.steps.sample_direct_light import add_direct_light, sample_direct_light
from renderer.kernel.steps.scatter import cross_surface, scatter
from renderer.kernel.steps.splitting import beside, splits, turned
from renderer.kernel.steps.state import Crossings, LastVertex, camera_path, no_crossings, with_radiance, with_throughput
from renderer.kernel.surface.surface import shines, surface_at
from renderer.prune_absent_features import where_present

__all__ = ["has_lights", "trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_YES, _NO = np.bool_(True), np.bool_(False)


@template
def trace_path(scene, stack, camera, medium_stack, options, log, first, lit, weigh_hit, weigh_light, sample_bsdf):
    """Traces one sample along its CameraRay: (radiance, number of rays).

    medium_stack: media that contain the camera, 0 in a scene without media. log: rows for path_trace.py, none for frames; first:
    (FIRST_HIT_SLOTS,), filled for `load_first_hit`. The strategy to find light: lit, whether next-event estimation finds
    anything; weigh_hit(options, ray, path, last, point or None, light_pdf) and weigh_light(options, light, scatter_pdf, branches,
    point), MIS weights; sample_bsdf(scene, vertex, options, choose, u), a BsdfSample.
    """
    ray, path = camera_path(camera.o, camera.d)
    last, crossings, passed, rays = LastVertex(camera.o, _BLACK), no_crossings(medium_stack, camera.start), _ZERO, 0
    light, own_log, stream = _BLACK, log, camera.stream
    while True:
        state = ray, path, last, crossings, passed
        path, splits_here, state, more = _follow(
            scene, stack, state, camera, stream, options, own_log, first, lit, weigh_hit, weigh_light, sample_bsdf
        )
        rays += more
        light = vec.add(light, path.radiance)
        if not splits_here:
            break
        ray, path, last, crossings, passed = state
        stream, own_log = beside(stream), log[:0]
    if path.number > _ZERO:
        record_beside(log, path.radiance)
    return light, rays


@template
def _follow(scene, stack, state, camera, stream, options, log, first, lit, weigh_hit, weigh_light, sample_bsdf):
    """Follows a path to its end: (PathState, whether it splits, state of the second branch, number of rays)."""
    ray, path, last, crossings, passed = state
    other, splits_here, rays, time = state, _NO, 0, camera.time
    layers = local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        root = camera_root(scene.bvh) if path.number == _ZERO else _ROOT
        hit = closest_hit(scene.bvh, stack, ray.o, ray.d, _INF, time, root, after)
        rays += 1
        row, drifts, distance = path.number + passed, _NO, hit.t
        entry = np.int64(row)
        if scene.has.media is not None:
            event = medium_event(scene, path, crossings, hit.t, stream, row)
            drifts, distance, path = event.scatters, event.distance, with_throughput(path, event.throughput)
        if hit.primitive == NO_PRIMITIVE and not drifts:
            if entry < len(log):
                record_miss(log, entry, ray, path)
            path = _add_environment(scene, ray, path, last, options, time, weigh_hit)
            if entry < len(log):
                record_light(log, entry, EMITTED, path.radiance)
            break
        if scene.has.media is not None and drifts:
            vertex = medium_vertex(scene, ray, event, layers)
            normal = _BLACK
            if entry < len(log):
                record_medium(log, entry, vertex.surface.point, distance, ray, path)
        else:
            surface = surface_at(scene, ray.o, ray.d, hit)
            through, path = arrive(scene, surface, path, last, row, stream, options, time)
            if entry < len(log):
                record_surface(log, entry, surface, surface.point, through, hit.t, ray, path)
            if shines(surface) and ray.pdf >= _ZERO and counts_emission(scene, surface, through):
                seen = emitted_light(scene, surface, _YES, ray, last, time)
                weight = weigh_hit(options, ray, path, last, surface.point, seen.light_pdf)
                path = add_light(path, vec.scale(seen.radiance, weight), _YES, options)
            if through:
                if entry < len(log):
                    record_light(log, entry, EMITTED, path.radiance)
                crossings, blocked = pass_through(scene, surface, through, crossings, options)
                if blocked:
                    break
                passed += _ONE
                crossings = Crossings(crossings.medium_stack, crossings.counts, hit.t)
                after = where_present(scene.has.textures, (hit.t, hit.instance, hit.primitive))
                continue
            vertex, path = surface_vertex(scene, surface, ray, path, stream, layers, time)
            normal = vertex.frame[2]
        is_surface, unlit = vertex.material.kind != MEDIUM, vertex.material.kind == UNLIT
        if path.number == _ZERO:
            store_first_hit(first, record_first_hit(vertex.surface, vertex.material, normal, distance, camera.start))
        path = add_light(path, vertex.material.base, unlit, options)
        if entry < len(log):
            record_light(log, entry, EMITTED, path.radiance)
        if is_last(path, crossings.counts, unlit, options):
            break
        if scene.has.media is not None:
            vertex, path = enter_subsurface(scene, stack, vertex, path, stream, time)
            if vec.maximum(path.throughput) <= _ZERO:
                break

        specular = is_specular(vertex.material)
        if lit and not specular:
            path, shadow_rays = _add_direct(scene, stack, vertex, path, crossings, is_surface, options, stream, time, weigh_light)
            rays += shadow_rays
            if entry < len(log):
                record_light(log, entry, DIRECT, path.radiance)

        u = draw_scattering(stream, path.number)
        branches = np.float32(options.splitting) if splits(path.number, specular) else _ONE
        last = LastVertex(vertex.surface.point, vertex.normal)
        if branches > _ONE:
            v = turned(u)
            sample = sample_bsdf(scene, vertex, options, v[2], (v[0], v[1]))
            dark = with_radiance(path, _BLACK)
            own_ray, second, bounce = scatter(vertex.surface, vertex.frame, ray, dark, sample, branches, options)
            second, survival = continue_or_end(second, own_ray, v[3], is_surface, options)
            if not survival <= _ZERO:
                beyond = cross_surface(scene, vertex.surface, crossings, bounce, is_surface)
                other, splits_here = (own_ray, second, last, beyond, passed), _YES
        sample = sample_bsdf(scene, vertex, options, u[2], (u[0], u[1]))
        ray, path, bounce = scatter(vertex.surface, vertex.frame, ray, path, sample, branches, options)
        crossings = cross_surface(scene, vertex.surface, crossings, bounce, is_surface)
        path, survival = continue_or_end(path, ray, u[3], is_surface, options)
        if survival <= _ZERO:
            break
        after = where_present(scene.has.textures, FROM_ORIGIN)
    return path, splits_here, other, rays


@device
def has_lights(scene):
    """Returns True if the scene has anything that next-event estimation can sample."""
    return scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0


@template
def _add_environment(scene, ray, path, last, options, time, weigh_hit):
    """Returns the path with the light of the environment and of suns added where its ray has hit nothing."""
    counts = ray.pdf >= _ZERO
    seen = emitted_by_environment(scene, ray)
    path = add_light(path, vec.scale(seen.radiance, weigh_hit(options, ray, path, last, None, seen.light_pdf)), counts, options)
    if scene.has.lights is not None:
        for which in range(len(scene.sun)):
            seen = emitted_by_sun(scene, which, ray, last, path.number, time)
            weight = weigh_hit(options, ray, path, last, None, seen.light_pdf)
            path = add_light(path, vec.scale(seen.radiance, weight), counts, options)
    return path


@template
def _add_direct(scene, stack, vertex, path, crossings, is_surface, options, stream, time, weigh_light):
    """Returns (the path with the direct light at its vertex, number of shadow rays)."""
    surface = vertex.surface
    s, t, n = vertex.frame
    rays = 0
    count = options.light_samples if path.number == _ZERO else 1
    for k in range(count):
        numbers = draw_light(substream(stream, k, count) if count > 1 else stream, path.number)
        light = sample_light(scene, surface.point, vertex.normal, numbers[2], (numbers[0], numbers[1]), time)
        if light.pdf > _ZERO:
            wi = vec.to_local(s, t, n, light.direction)
            f, scatter_pdf = eval_material(vertex.material, vertex.wo, wi)
            branches = branches_to_light(light.alone, path.number, options)
            weight = weigh_light(options, light, scatter_pdf, branches, surface.point) / np.float32(count)
            shadow = sample_direct_light(scene, surface, path, light, wi, f, weight, crossings.medium_stack, is_surface)
            if shadow.is_cast:
                rays += 1
                left = left_between(scene, stack, shadow, crossings.counts, options, time)
                if vec.maximum(left) > _ZERO:
                    radiance = add_direct_light(path.radiance, shadow.brought, left, shadow.segments, options)
                    path = with_radiance(path, radiance)
    return path, rays
