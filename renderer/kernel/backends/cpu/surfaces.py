"""Processes the hits and misses of rays: adds emission and environment light, and prepares surfaces for scattering."""

from __future__ import annotations

import numpy as np

from renderer.arrays import rows as kinds
from renderer.bvh.simd import load_int
from renderer.bvh.traverse import Hit
from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.caustics import arrive_with_chain, chain_of, has_sampled_caustic
from renderer.kernel.backends.cpu.lists import (
    CONDUCTOR,
    DIFFUSE,
    DONE,
    LIT,
    METALLIC_ROUGHNESS,
    MISSED,
    PASSED,
    RARE,
    RARE_SPECULAR,
    SCATTERING,
    SPECULAR,
    SPHERES,
    SUBSURFACE_VERTICES,
    TRIANGLES,
    append,
    clear,
    eight_rows,
    length,
    pad,
    row,
)
from renderer.kernel.backends.cpu.material_stage import surfaces_at, texture_factors_of
from renderer.kernel.backends.cpu.reflections import add_arriving_light, is_from_catcher, meet_objects
from renderer.kernel.backends.cpu.rows import (
    Appearance,
    Axes,
    ChosenLight,
    Facet,
    Mapped,
    RowHit,
    Sample,
    Shading,
    at,
    column,
    gather,
    group_row,
    last_vertex,
    path_wavelengths,
    scatter,
    spare_where_not,
    streams_of,
    time_of,
)
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.light_groups import add_group_light, group_of_environment, group_of_light, group_of_material
from renderer.kernel.light_paths import EMISSION, ENVIRONMENT, add_path_light
from renderer.kernel.material.material import Parameters, has_flag, parameters_at, relative_index
from renderer.kernel.material.normal_map import shading_frame
from renderer.kernel.spectrum.upsampling import light_at, reflectance_at
from renderer.kernel.steps.continue_or_end import is_last
from renderer.kernel.steps.disperse import disperse
from renderer.kernel.steps.emitted_light import (
    add_light,
    background_counts,
    brought_light,
    emitted_by_environment,
    emitted_by_sun,
    emitted_light,
)
from renderer.kernel.steps.mis import hit_weight
from renderer.kernel.steps.pass_through import absorb, counts_emission, is_passed, pass_through
from renderer.kernel.steps.record_first_hit import record_background, record_catcher, record_first_hit, with_albedo
from renderer.kernel.steps.state import Crossings, PathState, Ray, no_crossings, with_throughput
from renderer.kernel.surface.surface import is_emissive, sphere_at
from renderer.wide.values import any_of, as_wide, lookup, not_, u32, where, where3, zero_like

__all__ = ["shade_hit", "shade_hits", "shade_miss", "shade_misses"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_ONE_BIT = np.uint32(1)
_HOLDOUT, _CATCHES = np.uint32(kinds.HOLDOUT), np.uint32(kinds.CATCHES)
_RARE_KINDS = np.uint32(kinds.RARE_KINDS)
_DIFFUSE, _METALLIC_ROUGHNESS, _CONDUCTOR, _UNLIT = (
    np.uint32(kind) for kind in (kinds.DIFFUSE, kinds.METALLIC_ROUGHNESS, kinds.CONDUCTOR, kinds.UNLIT)
)
_RARE_METAL, _SCATTERS_WITHIN = np.uint32(kinds.NEEDS_TANGENT | kinds.BECKMANN), np.uint32(kinds.SCATTERS_WITHIN)
_TRANSMITS = np.uint32(kinds.TRANSMITS)
_TO_DIFFUSE, _TO_SPECULAR, _TO_METALLIC_ROUGHNESS, _TO_CONDUCTOR, _TO_RARE, _TO_RARE_SPECULAR, _TO_WITHIN = (
    np.uint32(which) for which in (DIFFUSE, SPECULAR, METALLIC_ROUGHNESS, CONDUCTOR, RARE, RARE_SPECULAR, SUBSURFACE_VERTICES)
)
_OVER, _THROUGH = np.uint32(DONE), np.uint32(PASSED)
_LIST, _LIGHT_PDF = column(Shading, "list"), column(ChosenLight, "pdf")


@template
def shade_miss(scene, pool, rows, options, is_recorded):
    """Adds environment and sun light to the paths in one row of the pool or in eight. is_recorded: as for `shade_hits`."""
    ray, path = gather(pool, rows, Ray), gather(pool, rows, PathState)
    seen, counts, before = emitted_by_environment(scene, ray), background_counts(ray, path, options), path.radiance
    reflected = is_from_catcher(scene, pool, rows, path, options)
    if options.transparent_background:
        seen_first = spare_where_not(pool, path.number == _ZERO, rows)
        scatter(pool, seen_first, record_background(path.throughput))
    weight = hit_weight(ray.pdf, seen.light_pdf)
    if is_recorded:
        met = gather(pool, rows, RowHit)
        scatter(pool, rows, RowHit(met.t, met.u, met.v, met.primitive, met.instance, met.passed, met.object, weight))
    wavelengths = path_wavelengths(scene, pool, rows, options)
    light = vec.scale(light_at(scene, seen.radiance, wavelengths), weight)
    if scene.has.groups is not None:
        group = group_row(pool, rows, options) + group_of_environment(scene, weight)
        add_group_light(pool, group, brought_light(path, light, options), counts)
    if scene.has.light_paths is not None:
        first, brought = group_row(pool, rows, options), brought_light(path, light, options)
        add_path_light(pool, first, options, brought, path.number, ENVIRONMENT, counts)
    path = add_light(path, light, counts, options)
    if scene.has.lights is not None:
        last, time = last_vertex(scene, pool, rows), time_of(scene.has.motion, pool, rows)
        kind = gather(pool, rows, Crossings).ray_kind
        if scene.has.reflections is not None:
            counts = counts & not_(reflected & (ray.pdf > _ZERO))  # light samples find suns
        for which in range(len(scene.sun)):
            seen = emitted_by_sun(scene, which, ray, last, path.number, kind, time)
            light = vec.scale(light_at(scene, seen.radiance, wavelengths), hit_weight(ray.pdf, seen.light_pdf))
            shows = counts
            if scene.caustics is not None:
                sun = as_wide(np.uint32(scene.sun[which]), weight)
                shows = counts & not_(has_sampled_caustic(scene, chain_of(pool, rows, path, options), sun, counts))
            if scene.has.groups is not None:
                sun = as_wide(np.uint32(scene.sun[which]), weight)
                group = group_row(pool, rows, options) + group_of_light(scene, sun)
                add_group_light(pool, group, brought_light(path, light, options), shows)
            if scene.has.light_paths is not None:
                first, brought = group_row(pool, rows, options), brought_light(path, light, options)
                add_path_light(pool, first, options, brought, path.number, ENVIRONMENT, shows)
            path = add_light(path, light, shows, options)
    if scene.has.reflections is not None and any_of(reflected):
        add_arriving_light(scene, pool, rows, reflected, before, path, options)
    scatter(pool, rows, path)


@subroutine
def shade_misses(scene, pool, lists, options, is_recorded):
    """Adds environment and sun light to the paths that hit nothing, and ends them. is_recorded: as for `shade_hits`."""
    never_inline()
    count = pad(lists, MISSED)
    for k in range(0, count, 8):
        shade_miss(scene, pool, eight_rows(lists, MISSED, k), options, is_recorded)
    for k in range(count):
        append(lists, DONE, row(lists, MISSED, k))


@device
def _list_of(scene, material, kind, roughness):
    """Returns the number of the list on which a vertex with this material is scattered: one list per scattering model."""
    smooth = (kind == _CONDUCTOR) & (roughness <= SMOOTH_GLASS)
    which = where(kind == _DIFFUSE, _TO_DIFFUSE, where(kind == _METALLIC_ROUGHNESS, _TO_METALLIC_ROUGHNESS, _TO_SPECULAR))
    which = where((kind == _CONDUCTOR) & not_(smooth), _TO_CONDUCTOR, which)
    if scene.has.layers is not None:
        rare = (kind == _CONDUCTOR) & has_flag(scene, material, _RARE_METAL)
        which = where(rare, where(smooth, _TO_RARE_SPECULAR, _TO_RARE), which)
        which = where(((_RARE_KINDS >> kind) & _ONE_BIT) != _NONE, _TO_RARE, which)
    return which


@device
def _store_appearance(scene, pool, rows, surface, through, parameters, eta, frame):
    """Writes the materials and shading frames of the paths' vertices to their rows of the pool, in scenes with textures."""
    if scene.has.textures is not None:
        s, t, n = frame
        none = zero_like(eta)
        base, metallic, roughness, _ = parameters
        facing = where3(has_flag(scene, surface.material, _TRANSMITS), (none, none, none), n)
        number = u32(surface.object)
        if any_of(through):  # if passed, the last vertex's normal and object stay
            last = gather(pool, rows, Mapped)
            facing, number = where3(through, last.facing, facing), where(through, last.object, number)
        scatter(pool, rows, Appearance(base, metallic, roughness, eta, surface.uv))
        scatter(pool, rows, Axes(s, t, surface.uv1))
        scatter(pool, rows, Mapped(n, facing, number))


@template
def shade_hit(scene, pool, rows, which, find_surface, find_factors, options, is_recorded):
    """Processes the surfaces hit by the paths in one row of the pool or in eight: adds emission, and stores their vertices.

    Writes to Shading the list on which each path belongs next. which: the list on which the paths are, passed to
    find_surface(scene, which, o, d, hit), which returns the Surface; find_factors(scene, surface, time) returns the texture
    factors as `texture_factors_of` does. is_recorded: as for `shade_hits`.
    """
    ray, path, met = gather(pool, rows, Ray), gather(pool, rows, PathState), gather(pool, rows, RowHit)
    time, passed = time_of(scene.has.motion, pool, rows), met.passed
    none = zero_like(ray.pdf)
    hit = Hit(met.t, met.primitive, met.u, met.v, met.instance, time)
    surface = find_surface(scene, which, ray.o, ray.d, hit)
    stream = streams_of(pool, rows, options)
    through = is_passed(scene, surface, stream, path.number + passed, options, time)
    wavelengths, last_point = path_wavelengths(scene, pool, rows, options), gather(pool, rows, Facet).point
    path = with_throughput(path, absorb(scene, surface, through, path.throughput, last_point, wavelengths))
    lit, weight = is_emissive(surface) & (ray.pdf >= _ZERO) & counts_emission(scene, surface, through), none
    first = (path.number == _ZERO) & not_(through)
    if options.has_mattes:
        held, caught = (
            first & has_flag(scene, surface.material, _HOLDOUT),
            first & has_flag(scene, surface.material, _CATCHES),
        )
        lit = lit & not_(held | caught)
    reflected, before = is_from_catcher(scene, pool, rows, path, options), path.radiance
    meets, over = reflected & not_(through), first & not_(first)
    if scene.has.reflections is not None:
        over = meets & has_flag(scene, surface.material, _CATCHES)
        lit = lit & not_(reflected & (ray.pdf > _ZERO)) & not_(over)  # light samples find it
    if scene.caustics is not None:
        chain = chain_of(pool, rows, path, options)
        lit = lit & not_(has_sampled_caustic(scene, chain, surface.light, lit))
        arrive_with_chain(scene, pool, rows, chain, through, options)
    if any_of(lit):
        seen = emitted_light(scene, surface, lit, ray, last_vertex(scene, pool, rows), time)
        weight = hit_weight(ray.pdf, seen.light_pdf)
        light = vec.scale(light_at(scene, seen.radiance, wavelengths), weight)
        if scene.has.groups is not None:
            group = group_row(pool, rows, options) + group_of_light(scene, where(lit, surface.light, _NONE))
            add_group_light(pool, group, brought_light(path, light, options), lit)
        if scene.has.light_paths is not None:
            brought = brought_light(path, light, options)
            add_path_light(pool, group_row(pool, rows, options), options, brought, path.number, EMISSION, lit)
        path = add_light(path, light, lit, options)
    if scene.has.reflections is not None and any_of(reflected):
        add_arriving_light(scene, pool, rows, reflected & not_(over), before, path, options)
        last, kind = last_vertex(scene, pool, rows), gather(pool, rows, Crossings).ray_kind
        meets, hides = meets & not_(over), not_(is_emissive(surface))
        path = meet_objects(scene, pool, rows, meets, hides, ray, path, last, kind, time, wavelengths, options)

    frame = shading_frame(scene, surface, vec.neg(ray.d), time)
    parameters = parameters_at(scene, surface, find_factors(scene, surface, time))
    not_through = not_(through)
    ior, throughput = disperse(scene, surface, parameters.ior, path.throughput, not_through, stream, path.number, wavelengths)
    path = with_throughput(path, throughput)
    albedo = parameters.base
    if scene.spectrum is not None:
        base = reflectance_at(scene, albedo, wavelengths)
        parameters = Parameters(base, parameters.metallic, parameters.roughness, parameters.ior)
    eta = relative_index(ior, surface.front)
    _store_appearance(scene, pool, rows, surface, through, parameters, eta, frame)
    kind = u32(lookup(scene.material_kind, surface.material))
    unlit = (kind == _UNLIT) & not_(through)
    if options.has_mattes:
        unlit = unlit & not_(held | caught | over)
    if any_of(unlit):
        if scene.has.groups is not None:
            group = group_row(pool, rows, options) + group_of_material(scene, surface.material)
            add_group_light(pool, group, brought_light(path, parameters.base, options), unlit)
        if scene.has.light_paths is not None:
            brought = brought_light(path, parameters.base, options)
            add_path_light(pool, group_row(pool, rows, options), options, brought, path.number, EMISSION, unlit)
        path = add_light(path, parameters.base, unlit, options)
    if any_of(first):
        seen = record_first_hit(surface, parameters, frame[2], hit.t, gather(pool, rows, Sample).start)
        if scene.spectrum is not None:
            seen = with_albedo(seen, albedo)
        scatter(pool, spare_where_not(pool, first, rows), seen)
        if options.has_mattes:
            scatter(pool, spare_where_not(pool, caught, rows), record_catcher(seen, path.throughput))
            scatter(pool, spare_where_not(pool, held, rows), record_background(path.throughput))

    which_next = _list_of(scene, surface.material, kind, parameters.roughness)
    if scene.has.media is not None:
        which_next = where(has_flag(scene, surface.material, _SCATTERS_WITHIN), _TO_WITHIN, which_next)
    crossings = no_crossings(_NONE, none)
    if options.has_depths or scene.has.media is not None:
        crossings = gather(pool, rows, Crossings)
    which_next = where(is_last(path, crossings.counts, unlit, options), _OVER, which_next)
    if options.has_mattes:
        which_next = where(held | over, _OVER, which_next)
    point = surface.point
    if scene.has.textures is not None and any_of(through):
        passed, ends = where(through, passed + _ONE, passed), passed != passed
        if scene.has.media is not None or options.has_depths:
            crossings, ends = pass_through(scene, surface, through, crossings, options)
            scatter(pool, rows, crossings)
        which_next = where(through, where(ends, _OVER, _THROUGH), which_next)
        point = where3(through, gather(pool, rows, Facet).point, point)  # if passed, the last vertex stays
    if scene.has.textures is not None or is_recorded:  # subsurface walks read the object's number
        weight = where(lit, weight, none)
        scatter(pool, rows, RowHit(met.t, met.u, met.v, met.primitive, met.instance, passed, surface.object, weight))
    if scene.has.textures is not None or any_of(lit | unlit):
        scatter(pool, rows, path)
    scatter(pool, rows, Facet(point, surface.error, surface.geometric, surface.front, surface.smooth))
    scatter(pool, rows, Shading(surface.shading, surface.lift, surface.material, which_next))


@device
def _find_surfaces(scene, which, o, d, hit):
    """Returns the surfaces at the hits of eight rays, which are all on the list TRIANGLES or all on SPHERES."""
    if which == TRIANGLES:
        surface = surfaces_at(scene, d, hit)
    else:
        surface = sphere_at(scene, o, d, hit)
    return surface


@subroutine
def _arrive(scene, pool, lists, which, options, is_recorded):
    """Processes the surfaces hit by the paths on one list, as `shade_hit` does."""
    never_inline()
    for k in range(0, pad(lists, which), 8):
        rows = eight_rows(lists, which, k)
        shade_hit(scene, pool, rows, which, _find_surfaces, texture_factors_of, options, is_recorded)


@subroutine
def shade_hits(scene, pool, lists, options, is_recorded):
    """Processes the surfaces that the rays have hit: adds emission, and lists the paths by their scattering model.

    is_recorded: whether a path is being recorded.
    """
    never_inline()
    for which in range(SCATTERING):
        clear(lists, which)
    clear(lists, LIT)
    clear(lists, PASSED)
    if scene.has.media is not None:
        clear(lists, SUBSURFACE_VERTICES)
    for which in (TRIANGLES, SPHERES):
        if length(lists, which) > 0:
            _arrive(scene, pool, lists, which, options, is_recorded)
            for k in range(length(lists, which)):
                path = row(lists, which, k)
                into = np.int64(load_int(pool, at(path, _LIST)))
                if into == RARE_SPECULAR:
                    pool[at(path, _LIGHT_PDF)] = _ZERO  # no light
                    into = RARE
                elif into <= RARE and into != SPECULAR:
                    append(lists, LIT, path)
                append(lists, into, path)
