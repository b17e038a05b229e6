"""The path tracer that follows one path at a time: the steps of renderer/kernel/steps in order.

Unidirectional paths with next-event estimation, multiple importance sampling, and Russian roulette, after Veach, "Robust Monte
Carlo Methods for Light Transport Simulation" (1997); pbrt 4ed, 13.4 has the same steps. Frames are rendered by
renderer/kernel/backends/cpu, which computes the same bits of each sample.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import CATCHES, HOLDOUT, MEDIUM, UNLIT
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit
from renderer.jit import local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import (
    FIRST_GROUP,
    is_from_catcher,
    store_direct_light,
    store_first_hit,
    store_reflection,
)
from renderer.kernel.backends.scalar.light import add_direct, add_emission, add_environment, caustic_light
from renderer.kernel.backends.scalar.vertex import LAYER_SLOTS, medium_vertex, reach_surface, subsurface_vertex, surface_vertex
from renderer.kernel.light_groups import add_group_light, group_of_material, group_of_media
from renderer.kernel.light_paths import EMISSION, add_path_light, forget_lights, share_after_vertex, store_share
from renderer.kernel.manifold.chain import NO_CHAIN, begin_chain, continue_chain, is_joined
from renderer.kernel.material.material import (
    eval_diffuse_lobes,
    eval_material,
    factors_at,
    has_flag,
    is_specular,
    parameters_at,
)
from renderer.kernel.medium.medium_stack import medium_albedo
from renderer.kernel.options import MIS
from renderer.kernel.path_trace import (
    DIRECT,
    EMITTED,
    record_light,
    record_medium,
    record_miss,
    record_second_branch,
    record_surface,
)
from renderer.kernel.spectrum.light_planes import planes_to_rgb
from renderer.kernel.spectrum.wavelengths import to_rgb, wavelengths_of
from renderer.kernel.steps.aim import NOT_AIMED, aim, aimed_sample, mixture_pdf, targets_in_view
from renderer.kernel.steps.catch_reflections import background_light, catches_reflections, luminance_on_film
from renderer.kernel.steps.continue_or_end import continue_or_end, is_last
from renderer.kernel.steps.emitted_light import add_light, add_medium_light, brought_light
from renderer.kernel.steps.guide import choose_guided, guided_sample
from renderer.kernel.steps.medium_event import medium_event
from renderer.kernel.steps.pass_through import pass_through
from renderer.kernel.steps.random_blocks import draw_scattering
from renderer.kernel.steps.ray_kind import after_vertex
from renderer.kernel.steps.record_first_hit import record_background, record_catcher, record_first_hit, with_albedo
from renderer.kernel.steps.scatter import cross_surface, scatter
from renderer.kernel.steps.splitting import second_branch_numbers, second_branch_stream, splits
from renderer.kernel.steps.state import (
    BsdfSample,
    Crossings,
    LastVertex,
    camera_path,
    no_crossings,
    with_radiance,
    with_ray_kind,
    with_throughput,
)
from renderer.kernel.surface.surface import NO_OBJECT, is_emissive, surface_at
from renderer.prune_absent_features import where_present
from renderer.wide.values import lookup, u32

__all__ = ["trace_path"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_YES, _NO = np.bool_(True), np.bool_(False)
_HOLDOUT, _CATCHES = np.uint32(HOLDOUT), np.uint32(CATCHES)


@template
def trace_path(scene, stack, camera, medium_stack, options, log, first, lit, weigh_hit, weigh_light, sample_bsdf):
    """Traces one sample along its CameraRay; returns (radiance, number of rays).

    medium_stack: media that contain the camera, 0 in a scene without media. log: rows for path_trace.py; none for frames. first:
    (FIRST_HIT_SLOTS,), receives the FirstHit; with light groups it has rows from FIRST_GROUP on, for those of both branches. The
    other arguments are the strategy to find light. lit: whether next-event estimation finds anything. weigh_hit(options, ray,
    path, last, point or None, light_pdf) and weigh_light(options, light, scatter_pdf, branches, point) return MIS weights.
    sample_bsdf(scene, vertex, options, choose, u) returns a BsdfSample.
    """
    ray, path = camera_path(camera.o, camera.d)
    state = ray, path, LastVertex(camera.o, _BLACK, NO_OBJECT), no_crossings(medium_stack, camera.start), _ZERO, NO_CHAIN
    stream, own_log, light, rays, groups = camera.stream, log, _BLACK, 0, FIRST_GROUP
    while True:
        path, splits_here, state, more = _follow(
            scene, stack, state, camera, stream, options, own_log, first, groups, lit, weigh_hit, weigh_light, sample_bsdf
        )
        rays += more
        brought = path.radiance
        if scene.spectrum is not None:
            brought = to_rgb(scene.spectrum, camera.stream, brought)
            if scene.has.by_light is not None:
                planes_to_rgb(scene.spectrum, camera.stream, first, groups, options)
        light = vec.add(light, brought)
        if not splits_here:
            break
        stream, own_log, groups = second_branch_stream(stream), log[:0], FIRST_GROUP + options.group_rows
    if path.number > _ZERO:
        record_second_branch(log, path.radiance)
    return light, rays


@template
def _follow(scene, stack, state, camera, stream, options, log, first, groups, lit, weigh_hit, weigh_light, sample_bsdf):
    """Follows one branch of a path to its end.

    Returns (PathState, whether the path splits, start state of the second branch, number of rays). A start state is (Ray,
    PathState, LastVertex, Crossings, number of surfaces passed, a float, state of its chain of kernel/manifold/chain.py). groups:
    the row of the branch's light by group.
    """
    ray, path, last, crossings, passed, chain = state
    other, splits_here, rays, time = state, _NO, 0, camera.time
    wavelengths = wavelengths_of(scene, camera.stream)
    layers, spare = local_floats(LAYER_SLOTS), local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        root = camera_root(scene.bvh) if path.number == _ZERO else _ROOT
        if scene.has.visibility is not None:
            root = lookup(scene.bvh.ray_roots, crossings.ray_kind)
        hit = closest_hit(scene.bvh, stack, ray.o, ray.d, _INF, time, root, after)
        rays += 1
        row, drifts, distance = path.number + passed, _NO, hit.t
        held, caught = _NO, _NO
        reflected = is_from_catcher(scene, first, path, options)
        if scene.has.media is not None:
            event = medium_event(scene, ray, path, crossings, hit.t, stream, row, wavelengths)
            if scene.has.grids is not None:
                path, light = add_medium_light(path, event.emitted, options)
                if scene.has.groups is not None:
                    add_group_light(first, groups + group_of_media(scene), light, _YES)
                if scene.has.light_paths is not None:
                    add_path_light(first, groups, options, light, path.number, EMISSION, _YES)
            drifts, distance = event.scatters, event.distance
            if scene.has.reflections is not None and reflected and drifts:
                path = _meet_object(
                    scene, ray, path, last, crossings, time, wavelengths, options, weigh_hit, camera, first, groups, True
                )
            path = with_throughput(path, event.throughput)
        if hit.primitive == NO_PRIMITIVE and not drifts:
            record_miss(log, row, ray, path)
            before = path.radiance
            path = add_environment(scene, ray, path, last, crossings, chain, options, time, wavelengths, weigh_hit, first, groups)
            if scene.has.reflections is not None and reflected:
                added = vec.sub(path.radiance, before)
                store_direct_light(first, luminance_on_film(scene, camera.stream, added))
            record_light(log, row, EMITTED, path.radiance)
            break
        if scene.has.media is not None and drifts:
            vertex = medium_vertex(scene, ray, event, layers)
            normal = _BLACK
            record_medium(log, row, vertex.surface.point, distance, ray, path)
        else:
            surface = surface_at(scene, ray.o, ray.d, hit)
            through, path = reach_surface(scene, surface, path, last, row, stream, options, time, wavelengths)
            record_surface(log, row, surface, surface.point, through, hit.t, ray, path)
            if options.has_mattes and path.number == _ZERO and not through:
                held = has_flag(scene, surface.material, _HOLDOUT)
                caught = has_flag(scene, surface.material, _CATCHES)
            ends = reflected and not through and has_flag(scene, surface.material, _CATCHES)
            before = path.radiance
            if not (held or caught or ends):
                path = add_emission(
                    scene, surface, through, ray, path, last, chain, options, time, wavelengths, weigh_hit, first, groups
                )
            if scene.has.reflections is not None and reflected:
                if ends:
                    break
                added = vec.sub(path.radiance, before)
                store_direct_light(first, luminance_on_film(scene, camera.stream, added))
                if not through:
                    hides = not is_emissive(surface)
                    path = _meet_object(
                        scene, ray, path, last, crossings, time, wavelengths, options, weigh_hit, camera, first, groups, hides
                    )
            if through:
                record_light(log, row, EMITTED, path.radiance)
                crossings, blocked = pass_through(scene, surface, through, crossings, options)
                if blocked:
                    break
                passed += _ONE
                chain = NO_CHAIN
                crossings = Crossings(crossings.medium_stack, crossings.counts, hit.t, crossings.ray_kind)
                after = where_present(scene.has.textures, (hit.t, hit.instance, hit.primitive))
                continue
            vertex, path = surface_vertex(scene, surface, ray, path, stream, layers, time, wavelengths)
            normal = vertex.frame[2]
        is_surface, unlit = vertex.material.kind != MEDIUM, vertex.material.kind == UNLIT and not caught
        if held:
            store_first_hit(first, record_background(path.throughput))
            break
        if path.number == _ZERO:
            seen = record_first_hit(vertex.surface, vertex.material, normal, distance, camera.start)
            if scene.spectrum is not None and is_surface:
                seen = with_albedo(seen, parameters_at(scene, vertex.surface, factors_at(scene, vertex.surface, time)).base)
            if scene.spectrum is not None and scene.has.media is not None and drifts:
                seen = with_albedo(seen, medium_albedo(scene, crossings.medium_stack))
            if caught:
                seen = record_catcher(seen, path.throughput)
            store_first_hit(first, seen)
        if scene.has.groups is not None and unlit:
            group = groups + group_of_material(scene, vertex.surface.material)
            add_group_light(first, group, brought_light(path, vertex.material.base, options), unlit)
        if scene.has.light_paths is not None and unlit:
            brought = brought_light(path, vertex.material.base, options)
            add_path_light(first, groups, options, brought, path.number, EMISSION, unlit)
        path = add_light(path, vertex.material.base, unlit, options)
        record_light(log, row, EMITTED, path.radiance)
        if is_last(path, crossings.counts, unlit, options):
            break
        if scene.has.media is not None:
            vertex, path = subsurface_vertex(scene, stack, vertex, path, stream, time, wavelengths)
            if vec.maximum(path.throughput) <= _ZERO:
                break

        specular = is_specular(vertex.material)
        if lit and not specular:
            path, shadow_rays = add_direct(
                scene,
                stack,
                vertex,
                path,
                crossings,
                is_surface,
                options,
                stream,
                time,
                wavelengths,
                weigh_light,
                first,
                groups,
                caught,
            )
            rays += shadow_rays
            if scene.caustics is not None and is_joined(vertex.material):
                known = vertex, ray, path, last, chain, crossings.counts, options, stream, spare, time, wavelengths
                light, more = caustic_light(scene, stack, *known)
                path = with_radiance(path, vec.add(path.radiance, light))
                rays += more
            record_light(log, row, DIRECT, path.radiance)
        if caught and (scene.has.reflections is None or not catches_reflections(scene, caught, vertex.surface.material)):
            break

        u = draw_scattering(stream, path.number)
        branches = np.float32(options.splitting) if splits(path.number, specular) and not caught else _ONE
        last = LastVertex(vertex.surface.point, vertex.normal, u32(vertex.surface.object))
        begun = begin_chain(vertex.material, specular)
        if branches > _ONE:
            dark = with_radiance(path, _BLACK)
            numbers, behind = second_branch_numbers(u), groups + options.group_rows
            own_ray, second, beyond, survival, _ = _scatter(
                scene,
                vertex,
                ray,
                dark,
                crossings,
                stream,
                True,
                numbers,
                branches,
                is_surface,
                options,
                first,
                behind,
                sample_bsdf,
            )
            if not survival <= _ZERO:
                other, splits_here = (own_ray, second, last, beyond, passed, begun), _YES
        o, d = ray.o, ray.d
        ray, path, crossings, survival, bounce = _scatter(
            scene, vertex, ray, path, crossings, stream, False, u, branches, is_surface, options, first, groups, sample_bsdf
        )
        if survival <= _ZERO:
            break
        if scene.caustics is not None:
            chain = continue_chain(scene, chain, hit, o, d, bounce) if specular else begun
        after = where_present(scene.has.textures, FROM_ORIGIN)
    return path, splits_here, other, rays


@template
def _meet_object(scene, ray, path, last, crossings, time, wavelengths, options, weigh_hit, camera, first, groups, hides):
    """Returns a path whose first ray from a catcher has met an object: its light so far is that of the catcher.

    camera: the CameraRay. hides: whether the object is in front of the background. The others are as for `_follow`.
    """
    if hides:
        light = background_light(scene, ray, path, last, crossings.ray_kind, time, wavelengths, options, weigh_hit)
        store_direct_light(first, luminance_on_film(scene, camera.stream, light))
    store_reflection(first, luminance_on_film(scene, camera.stream, path.radiance))
    if scene.has.by_light is not None:
        forget_lights(first, groups, options)
    return with_radiance(path, _BLACK)


@template
def _scatter(scene, vertex, ray, path, crossings, stream, second, u, branches, is_surface, options, first, groups, sample_bsdf):
    """Scatters a path at its vertex, using the four random numbers u; returns (Ray, PathState, Crossings, survival, Bounce).

    stream, first, groups: as for `_follow`. second: whether to start the second branch.
    """
    choose, here = u[2], LastVertex(vertex.surface.point, vertex.normal, u32(vertex.surface.object))
    if scene.has.targets is not None:
        specular = is_specular(vertex.material)
        targets = targets_in_view(scene, here, vertex.surface.material, specular, is_surface, options)
        chosen = aim(scene, here, targets, choose, (u[0], u[1]))
        choose = chosen.choose
    if scene.path_guide is not None:
        guided = choose_guided(scene, here.point, vertex.frame[2], is_specular(vertex.material), is_surface, choose, (u[0], u[1]))
        choose = guided.choose
    sample = sample_bsdf(scene, vertex, options, choose, (u[0], u[1]))
    if scene.has.targets is not None:
        s, t, n = vertex.frame
        wi, f, pdf = vec.to_local(s, t, n, chosen.direction), _BLACK, _ZERO
        if chosen.is_aimed:
            f, pdf = eval_material(vertex.material, vertex.wo, wi)
        sample = aimed_sample(scene, here, targets, chosen, vertex.frame, sample, wi, f, pdf)
    if scene.path_guide is not None:
        s, t, n = vertex.frame
        wi, f, pdf = vec.to_local(s, t, n, guided.direction), _BLACK, _ZERO
        if guided.is_guided:
            f, pdf = eval_material(vertex.material, vertex.wo, wi)
        own = pdf
        if scene.has.targets is not None:
            own = mixture_pdf(scene, here, targets, guided.direction, pdf, NOT_AIMED)
        sample = guided_sample(scene, guided, vertex.frame, sample, wi, f, pdf, own)
    reflected, value = _BLACK, _BLACK
    if scene.has.visibility is not None or scene.has.light_paths is not None:
        reflected = eval_diffuse_lobes(vertex.material, vertex.wo, sample.wi)
        value = vec.scale(sample.weight, sample.pdf)
    if scene.has.visibility is not None:
        if options.sampling != MIS and not sample.pdf > _ZERO and not is_specular(vertex.material):  # its pdf is not stated
            value, _ = eval_material(vertex.material, vertex.wo, sample.wi)
        left = after_vertex(scene, stream, path.number, second, reflected, value, sample.wi, is_surface)
        reflected, value = left.diffuse, left.value
        sample = BsdfSample(sample.wi, vec.mul(sample.weight, left.factor), sample.pdf, sample.eta2, sample.unguided)
    if scene.has.light_paths is not None and path.number == _ZERO:
        share = share_after_vertex(reflected, value, sample.wi, is_surface)
        store_share(first, groups, options, share)
    ray, path, bounce = scatter(vertex.surface, vertex.frame, ray, path, sample, branches, options)
    crossings = cross_surface(scene, vertex.surface, crossings, bounce, is_surface)
    if scene.has.visibility is not None:
        crossings = with_ray_kind(crossings, left.kind)
    path, survival = continue_or_end(path, ray, u[3], is_surface, options)
    return ray, path, crossings, survival, bounce
