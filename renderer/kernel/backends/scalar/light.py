"""Light found by a single path: emission that its ray hits, and light samples at its vertices.

`weigh_hit` and `weigh_light` are functions that return MIS weights; see `trace_path` in path.py.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import shadow_root
from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import is_from_catcher, store_direct_light, store_first_hit
from renderer.kernel.backends.scalar.photon_light import meet_photon
from renderer.kernel.backends.scalar.visibility import shadow_transmittance
from renderer.kernel.light.light_sample import light_sample_at
from renderer.kernel.light.lights import choose_sampled, sample_chosen
from renderer.kernel.light.links import linked_sample
from renderer.kernel.light.visibility import sampled_visibility, shadow_root_of, with_visibility
from renderer.kernel.light_groups import add_group_light, group_of_environment, group_of_light, group_of_sample
from renderer.kernel.light_paths import (
    EMISSION,
    ENVIRONMENT,
    add_path_light,
    add_sampled_path_light,
    share_after_vertex,
    store_sampled_share,
)
from renderer.kernel.manifold.chain import BEGUN, is_sampled_elsewhere
from renderer.kernel.manifold.estimate import estimate_caustic
from renderer.kernel.manifold.meeting import is_met
from renderer.kernel.material.material import eval_diffuse_lobes, eval_material
from renderer.kernel.sampling.sampler import substream
from renderer.kernel.spectrum.upsampling import light_at
from renderer.kernel.steps.aim import NOT_AIMED, mixture_pdf, targets_in_view
from renderer.kernel.steps.catch_reflections import (
    branches_at_catcher,
    catches_reflections,
    ignores_shadows,
    luminance_on_film,
)
from renderer.kernel.steps.emitted_light import (
    add_light,
    background_counts,
    brought_light,
    clamp_indirect,
    emitted_by_environment,
    emitted_by_sun,
    emitted_light,
)
from renderer.kernel.steps.guide import choose_guided, guided_pdf
from renderer.kernel.steps.mis import branches_to_light
from renderer.kernel.steps.pass_through import counts_emission
from renderer.kernel.steps.portals import NO_PORTAL
from renderer.kernel.steps.random_blocks import draw_light
from renderer.kernel.steps.ray_kind import visible_lobes
from renderer.kernel.steps.record_first_hit import record_background
from renderer.kernel.steps.sample_direct_light import add_direct_light, direct_light, sample_direct_light
from renderer.kernel.steps.state import LastVertex, with_radiance
from renderer.kernel.surface.surface import is_emissive
from renderer.wide.values import lookup, u32

__all__ = ["add_direct", "add_emission", "add_environment", "caustic_light", "has_lights"]

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_WHITE = (_ONE, _ONE, _ONE)
_YES, _NO = np.bool_(True), np.bool_(False)


@device
def has_lights(scene):
    """Returns True if the scene has anything that next-event estimation can sample."""
    return scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0


@template
def add_environment(scene, ray, path, last, crossings, chain, options, time, wavelengths, weigh_hit, found, groups):
    """Returns `path` with the light of the environment and of suns added; called if the path's ray has hit nothing.

    From a catcher of reflections, suns count only along discrete directions; light samples find them along others.

    wavelengths: of the path (kernel/spectrum); None in RGB. chain: from kernel/manifold/chain.py. found: the array of the first
    hit, with the table of the light by group. groups: the row of the path's first group.
    """
    counts = background_counts(ray, path, options)
    if options.transparent_background and path.number == _ZERO:
        store_first_hit(found, record_background(path.throughput))
    seen = emitted_by_environment(scene, ray)
    light = light_at(scene, seen.radiance, wavelengths)
    light = vec.scale(light, weigh_hit(options, ray, path, last, None, seen.light_pdf))
    if scene.has.groups is not None:
        group = groups + group_of_environment(scene, ray.pdf)
        add_group_light(found, group, brought_light(path, light, options), counts)
    if scene.has.light_paths is not None:
        brought = brought_light(path, light, options)
        add_path_light(found, groups, options, brought, path.number, ENVIRONMENT, counts)
    path = add_light(path, light, counts, options)
    if scene.has.lights is not None:
        for which in range(len(scene.sun)):
            seen = emitted_by_sun(scene, which, ray, last, path.number, crossings.ray_kind, time)
            weight = weigh_hit(options, ray, path, last, None, seen.light_pdf)
            shows = counts and not (ray.pdf > _ZERO and is_from_catcher(scene, found, path, options))
            if scene.caustics is not None:
                shows = shows and not is_sampled_elsewhere(scene, chain, np.int64(scene.sun[which]))
            light = vec.scale(light_at(scene, seen.radiance, wavelengths), weight)
            if scene.has.groups is not None:
                group = groups + group_of_light(scene, np.uint32(scene.sun[which]))
                add_group_light(found, group, brought_light(path, light, options), shows)
            if scene.has.light_paths is not None:
                brought = brought_light(path, light, options)
                add_path_light(found, groups, options, brought, path.number, ENVIRONMENT, shows)
            path = add_light(path, light, shows, options)
    return path


@template
def add_emission(scene, surface, through, ray, path, last, chain, options, time, wavelengths, weigh_hit, found, groups):
    """Returns `path` with the emission of the surface that its ray has hit added.

    through: whether the path passes through that surface without scattering. wavelengths, chain, found, groups: as for
    `add_environment`.
    """
    counts = ray.pdf <= _ZERO or not is_from_catcher(scene, found, path, options)  # else light samples find it
    if counts and is_emissive(surface) and ray.pdf >= _ZERO and counts_emission(scene, surface, through):
        if scene.caustics is not None and is_sampled_elsewhere(scene, chain, np.int64(surface.light)):
            return path
        seen = emitted_light(scene, surface, _YES, ray, last, time)
        weight = weigh_hit(options, ray, path, last, surface.point, seen.light_pdf)
        light = vec.scale(light_at(scene, seen.radiance, wavelengths), weight)
        if scene.has.groups is not None:
            group = groups + group_of_light(scene, surface.light)
            add_group_light(found, group, brought_light(path, light, options), _YES)
        if scene.has.light_paths is not None:
            brought = brought_light(path, light, options)
            add_path_light(found, groups, options, brought, path.number, EMISSION, _YES)
        path = add_light(path, light, _YES, options)
    return path


@template
def add_direct(
    scene, stack, vertex, path, crossings, is_surface, options, stream, time, wavelengths, weigh_light, found, groups, caught
):
    """Samples the direct light at a path's vertex; returns (the path with that light added, number of shadow rays).

    wavelengths, found, groups: as for `add_environment`. caught: whether the vertex is on a catcher.
    """
    surface = vertex.surface
    s, t, n = vertex.frame
    rays = 0
    reflects, unshaded = _NO, _NO
    if scene.has.reflections is not None:
        reflects = catches_reflections(scene, caught, surface.material)
        unshaded = ignores_shadows(scene, caught, surface.material)
    count = options.light_samples if path.number == _ZERO else 1
    for k in range(count):
        own = substream(stream, k, count) if count > 1 else stream
        numbers = draw_light(own, path.number)
        which, chance = choose_sampled(scene, surface.point, vertex.normal, numbers[2])
        light = sample_chosen(scene, surface.point, vertex.normal, numbers[2], (numbers[0], numbers[1]), which, chance, time)
        if scene.has.links is not None:
            light = linked_sample(scene, numbers[2], which, light, u32(surface.object))
        if scene.spectrum is not None:
            light = light_sample_at(scene, light, wavelengths)
        root = shadow_root(scene.bvh)
        if scene.has.visibility is not None:
            word = sampled_visibility(scene, numbers[2], which)
            light = with_visibility(light, word)
            root = lookup(scene.bvh.ray_roots, shadow_root_of(word))
        if light.pdf > _ZERO:
            wi = vec.to_local(s, t, n, light.direction)
            f, scatter_pdf = eval_material(vertex.material, vertex.wo, wi)
            if scene.has.targets is not None:
                here = LastVertex(surface.point, vertex.normal, u32(surface.object))
                targets = targets_in_view(scene, here, surface.material, _NO, is_surface, options)
                scatter_pdf = mixture_pdf(scene, here, targets, light.direction, scatter_pdf, NOT_AIMED)
            if scene.path_guide is not None:
                guided = choose_guided(scene, surface.point, n, _NO, is_surface, _ONE, (_ZERO, _ZERO))
                scatter_pdf = guided_pdf(scene, guided, light.direction, scatter_pdf, NO_PORTAL)
            branches = branches_to_light(light.alone, path.number, options)
            if scene.has.reflections is not None and reflects:
                branches = branches_at_catcher(scene, numbers[2], light.alone)
            weight = weigh_light(options, light, scatter_pdf, branches, surface.point)
            if caught and not reflects:
                weight = _ONE
            weight = weight / np.float32(count)
            if scene.has.visibility is not None:
                lobes = eval_diffuse_lobes(vertex.material, vertex.wo, wi)
                lobes, f = visible_lobes(word, lobes, f, wi, is_surface)
            shadow = sample_direct_light(scene, surface, path, light, wi, f, weight, crossings.medium_stack, is_surface)
            if shadow.is_cast:
                if caught:
                    store_direct_light(found, luminance_on_film(scene, stream, shadow.brought))
                if scene.has.reflections is not None and unshaded:
                    radiance = add_direct_light(path.radiance, shadow.brought, _WHITE, shadow.segments, options)
                    path = with_radiance(path, radiance)
                    continue
                rays += 1
                known = shadow, crossings.counts, options, time, own, path.number, root
                left = shadow_transmittance(scene, stack, *known, wavelengths)
                if vec.maximum(left) > _ZERO:
                    if scene.has.groups is not None:
                        group = groups + group_of_sample(scene, numbers[2], which)
                        brought = direct_light(shadow.brought, left, shadow.segments, options)
                        add_group_light(found, group, brought, _YES)
                    if scene.has.light_paths is not None:
                        if path.number == _ZERO:
                            if scene.has.visibility is None:
                                lobes = eval_diffuse_lobes(vertex.material, vertex.wo, wi)
                            store_sampled_share(found, groups, options, share_after_vertex(lobes, f, wi, is_surface))
                        brought = direct_light(shadow.brought, left, shadow.segments, options)
                        add_sampled_path_light(found, groups, options, brought, path.number + _ONE, _YES)
                    radiance = add_direct_light(path.radiance, shadow.brought, left, shadow.segments, options)
                    path = with_radiance(path, radiance)
    return path, rays


@device
def caustic_light(scene, stack, vertex, ray, path, last, chain, counts, options, stream, layers, time, wavelengths):
    """Samples the light of small lamps through casters at a path's vertex; returns (what it adds to the path, number of rays).

    last: the LastVertex. chain: the state of the chain that ends at this vertex. counts: the path's depth counts. layers: as for
    `meet_photon`.
    """
    is_rivaled = chain == BEGUN and is_met(scene, vertex.surface.material, options)
    known = ray.roulette_weight, counts, last, is_rivaled, options, stream
    caustic = estimate_caustic(scene, stack, vertex, path, *known)
    sent = meet_photon(scene, stack, vertex, ray, path, counts, options, stream, layers, time, wavelengths)
    brought = clamp_indirect(vec.mul(path.throughput, caustic.radiance), caustic.segments, options.clamp)
    sent_on = clamp_indirect(vec.mul(path.throughput, sent.radiance), sent.segments, options.clamp)
    return vec.add(brought, sent_on), caustic.rays + sent.rays
