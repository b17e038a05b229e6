"""The single-path path tracer: finds light by any strategy, and can make deliberate errors for comparison.

Unidirectional paths with next-event estimation, multiple importance sampling, and Russian roulette, after Veach, "Robust Monte
Carlo Methods for Light Transport Simulation" (1997); pbrt 4ed, 13.4 has the same steps. Paths are followed one at a time, which
shows the steps in order; frames are rendered by renderer/kernel/pool/, which computes the same samples.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import MEDIUM, UNLIT
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit
from renderer.jit import device, local_floats, template
from renderer.kernel import vec
from renderer.kernel.integrators.depths import is_blocked, layers_left, spent
from renderer.kernel.integrators.inside import fly, may_go_within, scattered_within, vertex_in_medium
from renderer.kernel.integrators.mixture import mixture_bounce
from renderer.kernel.integrators.record import (
    DIRECT,
    EMITTED,
    record_beside,
    record_light,
    record_medium,
    record_miss,
    record_surface,
)
from renderer.kernel.integrators.roulette import IN_MEDIA, ON_SURFACES, survival
from renderer.kernel.integrators.splitting import beside, of_branch, turned
from renderer.kernel.integrators.state import (
    MAX_AGAIN,
    beyond,
    camera_path,
    passed_through,
    scattered,
    vertex_at,
    with_radiance,
    with_throughput,
)
from renderer.kernel.integrators.strategy import heuristic_weight, mistaken, share_of_light, special_bounce
from renderer.kernel.integrators.transport import forget_first_hit, keep_first_hit, limited, reach
from renderer.kernel.integrators.visibility import light_left, transmittance
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf, sample_light, sun_seen
from renderer.kernel.light.sphere_light import met_from_front
from renderer.kernel.material.material import LAYER_SLOTS, emission, eval_material, is_lamp, is_specular
from renderer.kernel.options import LIGHT, MIS, MIXTURE, NO_MISTAKE
from renderer.kernel.sampling.sampler import draw4, substream
from renderer.kernel.surface.ray_origins import departure
from renderer.kernel.surface.surface import shines, surface_at
from renderer.prune_absent_features import where_present

__all__ = ["trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_NO = np.bool_(False)


@template
def trace_path(scene, stack, o, d, time, nest, options, stream, log, first):
    """Traces one sample of one pixel along the ray o + t d, d unit: (radiance, number of rays).

    first: (FIRST_HIT_SLOTS,), filled for `first_hit` of transport.py.
    time: shutter time, 0 ... 1; None for a scene without motion. nest: media that contain the camera
    (kernel/medium/medium_stack.py);
    None for a scene without media. options: renderer.kernel.options.Options; log: rows for record.py, none for frames.
    """
    forget_first_hit(first)
    path, number, passed, rays = camera_path(o, d, nest), 0, 0, 0
    light, told = _BLACK, log
    while True:
        path, splits, other, passed, more = _follow(scene, stack, path, number, passed, time, options, stream, told, first)
        rays += more
        light = vec.add(light, path.radiance)
        if not splits:
            break
        path, number, stream = other, 1, beside(stream)
        told = log[:0]
    if number > 0:
        record_beside(log, path.radiance)
    return light, rays


@template
def _follow(scene, stack, path, number, passed, time, options, stream, log, first):
    """Follows the path to its end: (path, whether it splits, second branch, surfaces that branch has passed, number of rays).

    number: index of the first vertex to come; passed: number of surfaces that the ray has passed through by alpha. The second
    branch starts at the vertex where the path splits.
    """
    rays = 0
    other, passed_before, splits = path, 0, False
    lit = _has_lights(scene, options)
    layers = local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        # Needed only below, but independent of the ray: the processor computes them during the traversal.
        for_bounce = draw4(stream, np.uint32(2 * number + 2))
        for_light = draw4(stream, np.uint32(2 * number + 1))
        root = camera_root(scene.bvh) if number == 0 else _ROOT
        hit = closest_hit(scene.bvh, stack, path.o, path.d, _INF, time, root, after)
        rays += 1
        row = number + passed
        drifts = _NO
        if scene.has.media is not None:
            path, drift = fly(scene, path, after[0], hit.t, stream, row)
            drifts = drift.scatters
        if hit.primitive == NO_PRIMITIVE and not drifts:
            if row < len(log):
                record_miss(log, row, path)
            path = _add_environment(scene, path, number, options)
            path = _add_suns(scene, path, number, options, time)
            if row < len(log):
                record_light(log, row, EMITTED, path.radiance)
            break

        if scene.has.media is not None and drifts:
            vertex = vertex_in_medium(scene, path, drift, layers)
            if row < len(log):
                record_medium(log, row, vertex.surface.point, drift.distance, path)
        else:
            surface = surface_at(scene, path.o, path.d, hit)
            through, throughput = reach(scene, surface, path, options, stream, row, time)
            path = with_throughput(path, throughput)
            if row < len(log):
                record_surface(log, row, surface, through, hit.t, path)
            if is_lamp(scene, surface.material) or not through:
                path = _add_emission(scene, surface, path, number, options, time)
            if through:
                if row < len(log):
                    record_light(log, row, EMITTED, path.radiance)
                passed += 1
                if is_blocked(scene, surface.material, path.counts, options):
                    break
                if scene.has.textures is not None:
                    after = hit.t, hit.instance, hit.primitive
                path = passed_through(scene, surface, path)
                continue
            vertex, path = vertex_at(scene, surface, path, stream, number, layers, time)
        if number == 0:
            distance = hit.t
            if scene.has.media is not None:
                distance = drift.distance
            _keep_first(first, vertex, distance)
        if vertex.material.kind == UNLIT:
            path = _add(path, vertex.material.base, 1, options)
        if row < len(log):
            record_light(log, row, EMITTED, path.radiance)
        if path.depth + 1 >= options.max_depth or spent(path.counts, options) or vertex.material.kind == UNLIT:
            break
        if scene.has.media is not None and may_go_within(scene, vertex):
            vertex, path = scattered_within(scene, stack, vertex, path, stream, number, time)
            if vec.maximum(path.throughput) <= _ZERO:
                break

        if lit and not is_specular(vertex.material):
            path, shadow_rays = _add_direct(scene, stack, vertex, path, number, options, stream, for_light, time)
            rays += shadow_rays
            if row < len(log):
                record_light(log, row, DIRECT, path.radiance)

        branches = options.splitting if number == 0 and not is_specular(vertex.material) else 1
        if branches > 1:
            other = with_radiance(path, _BLACK)
            other, goes_on = _bounce(scene, vertex, other, number, options, turned(for_bounce), branches)
            if goes_on:
                splits, passed_before = True, passed
        path, goes_on = _bounce(scene, vertex, path, number, options, for_bounce, branches)
        if not goes_on:
            break
        after = where_present(scene.has.textures, FROM_ORIGIN)
        number += 1
        if number - path.depth > options.transmission_depth + MAX_AGAIN:
            break
    return path, splits, other, passed_before, rays


@template
def _keep_first(first, vertex, distance):
    """Records the path's first vertex; one in a medium has no normal."""
    normal = vertex.frame[2]
    if vertex.material.kind == MEDIUM:
        normal = _BLACK
    keep_first_hit(first, vertex.surface, vertex.material.base, normal, distance)


@template
def _has_lights(scene, options):
    """Whether the scene has anything that next-event estimation can sample."""
    lit = scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0
    if options.sampling != MIS and options.sampling != LIGHT:
        lit = len(scene.punctual_kind) > 0
    return lit


@device
def _add(path, light, segments, options):
    """Returns the path with light added, clamped if indirect.

    segments: number of further segments over which the light arrives.
    """
    return _add_weighed(path, vec.mul(path.throughput, light), segments, options)


@device
def _add_weighed(path, brought, segments, options):
    """As `_add`, of light times the path's throughput."""
    return with_radiance(path, vec.add(path.radiance, limited(brought, path.depth + segments, options.clamp)))


@template
def _add_environment(scene, path, number, options):
    """Adds the environment's radiance for a ray that missed, with its MIS weight against next-event estimation."""
    if path.pdf >= _ZERO:
        emitted, light_pdf = environment_seen(scene, path.d, path.pdf > _ZERO)
        weight = heuristic_weight(options.heuristic, path.pdf, light_pdf) if path.pdf > _ZERO else _ONE
        path = _add(path, vec.scale(emitted, weight), 1, options)
    return path


@template
def _add_suns(scene, path, number, options, time):
    """Adds the radiance of suns whose disks the ray hits, with their MIS weights."""
    if scene.has.lights is not None and path.pdf >= _ZERO:
        for k in range(len(scene.sun)):
            judged = path.pdf > _ZERO
            emitted, light_pdf = sun_seen(scene, k, path.vertex, path.normal, path.d, judged, number == 0, time)
            weight = heuristic_weight(options.heuristic, path.pdf, light_pdf) if judged else _ONE
            path = _add(path, vec.scale(emitted, weight), 1, options)
    return path


@template
def _add_emission(scene, surface, path, number, options, time):
    """Adds a surface's emission, with its MIS weight against next-event estimation."""
    if shines(surface) and path.pdf >= _ZERO:
        front = met_from_front(scene, surface.light, path.vertex, path.d, surface.front, time)
        emitted = emission(scene, surface.material, surface.uv, surface.uv1, front, time)
        weight = _ONE
        if path.pdf > _ZERO:
            cosine = vec.dot(surface.geometric, vec.neg(path.d))
            light_pdf = primitive_light_pdf(scene, surface.light, path.vertex, path.normal, surface.point, cosine, True, time)
            weight = heuristic_weight(options.heuristic, path.pdf, light_pdf)
        if options.mistake != NO_MISTAKE and number > 0:
            weight *= mistaken(options.mistake, path.vertex, surface.point)
        path = _add(path, vec.scale(emitted, weight), 1, options)
    return path


@template
def _add_direct(scene, stack, vertex, path, number, options, stream, numbers, time):
    """Adds direct light by next-event estimation: (path, number of shadow rays)."""
    surface, material = vertex.surface, vertex.material
    s, t, n = vertex.frame
    rays = 0
    count = options.light_samples if number == 0 else 1
    for k in range(count):
        if count > 1:
            numbers = draw4(substream(stream, k, count), np.uint32(2 * number + 1))
        light = sample_light(scene, surface.point, vertex.normal, numbers[2], (numbers[0], numbers[1]), time)
        if light.pdf > _ZERO and vec.maximum(light.radiance) > _ZERO:
            wi = vec.to_local(s, t, n, light.direction)
            f, scatter_pdf = eval_material(material, vertex.wo, wi)
            if vec.maximum(f) > _ZERO:
                start = departure(surface, wi[2] > _ZERO, light.direction)
                rays += 1
                left, layers = _BLACK, layers_left(path.counts, options)
                if scene.has.media is not None:
                    nest = path.nest if wi[2] > _ZERO else beyond(scene, vertex, path.nest)
                    left = light_left(scene, stack, start, light.end, nest, layers, time)
                else:
                    share = transmittance(scene, stack, start, light.end, options.transparent, layers, time)
                    left = share, share, share
                if vec.maximum(left) > _ZERO:
                    found_by = np.float32(options.splitting if number == 0 else 1) * scatter_pdf
                    weight = share_of_light(options, light.pdf, found_by, light.alone) / light.pdf / np.float32(count)
                    if options.mistake != NO_MISTAKE:
                        weight *= mistaken(options.mistake, surface.point, light.end)
                    brought = vec.mul(path.throughput, vec.scale(vec.mul(f, light.radiance), weight))
                    path = _add_weighed(path, vec.mul(brought, left), 2, options)
    return path, rays


@template
def _bounce(scene, vertex, path, number, options, numbers, branches):
    """Scatters the path at its vertex by the BSDF or the selected strategy: (path, whether it continues).

    branches: number of branches into which the vertex splits the path.
    """
    material, wo = vertex.material, vertex.wo
    u = (numbers[0], numbers[1])
    if options.sampling == MIXTURE and not is_specular(material):
        wi, weight, pdf, eta2 = mixture_bounce(scene, vertex.surface.point, vertex.frame, material, wo, numbers[2], u)
    else:
        wi, weight, pdf, eta2 = special_bounce(material, options.sampling, wo, numbers[2], u)
    weight, pdf = of_branch(weight, pdf, np.float32(branches))
    path = scattered(scene, vertex, path, number, wi, weight, pdf, eta2, np.float32(branches), options)
    most = ON_SURFACES
    if scene.has.media is not None and material.kind == MEDIUM:
        most = IN_MEDIA
    chance = survival(path.throughput, path.worth, np.float32(path.depth), options, most)
    goes_on = not (vec.maximum(path.throughput) <= _ZERO or numbers[3] >= chance)  # NaN propagates, so the film can count it
    return with_throughput(path, vec.scale(path.throughput, _ONE / chance)), goes_on
