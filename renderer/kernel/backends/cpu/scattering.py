"""Evaluates the sampled light at each vertex, and samples the path's next direction. Processes one list of vertices at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.bvh.simd import load_int
from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.bsdfs import (
    Material,
    eval_and_sample_conductor,
    eval_and_sample_diffuse,
    eval_and_sample_in_medium,
    eval_and_sample_metallic_roughness,
    eval_and_sample_rare,
    eval_and_sample_specular,
    eval_diffuse_lobe_diffuse,
    eval_diffuse_lobe_metallic_roughness,
    eval_diffuse_lobe_rare,
    eval_no_lobe,
)
from renderer.kernel.backends.cpu.caustics import leave_with_chain
from renderer.kernel.backends.cpu.lists import (
    ACTIVE,
    CONDUCTOR,
    DIFFUSE,
    MEDIUM_VERTICES,
    METALLIC_ROUGHNESS,
    NODES,
    RARE,
    RARE_SPECULAR,
    SPECULAR,
    append,
    eight_rows,
    length,
    pad,
    put,
    row,
    truncate,
)
from renderer.kernel.backends.cpu.rows import (
    PATHS,
    Appearance,
    Axes,
    ChosenLight,
    DirectLight,
    Facet,
    Mapped,
    Outcome,
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
    second_rows,
    spare_where_not,
    streams_of,
    surface_of,
    time_of,
)
from renderer.kernel.light.light_sample import LightSample
from renderer.kernel.light.visibility import shadow_root_of
from renderer.kernel.light_paths import share_after_vertex, store_sampled_share, store_share
from renderer.kernel.steps import scatter as scattering
from renderer.kernel.steps.aim import NOT_AIMED, aim, aimed_sample, mixture_pdf, targets_in_view
from renderer.kernel.steps.catch_reflections import catches_reflections, ignores_shadows, luminance_on_film
from renderer.kernel.steps.continue_or_end import continue_or_end
from renderer.kernel.steps.guide import choose_guided, guided_pdf, guided_sample
from renderer.kernel.steps.mis import light_weight
from renderer.kernel.steps.portals import NO_PORTAL
from renderer.kernel.steps.random_blocks import draw_scattering
from renderer.kernel.steps.ray_kind import after_vertex, visible_lobes
from renderer.kernel.steps.record_first_hit import FirstHit, record_direct_light
from renderer.kernel.steps.sample_direct_light import add_direct_light, sample_direct_light
from renderer.kernel.steps.splitting import second_branch_numbers, second_branch_stream, splits
from renderer.kernel.steps.state import BsdfSample, Crossings, PathState, Ray, with_radiance, with_ray_kind
from renderer.wide.values import any_of, as_wide, not_, to_int, u32, where, where3, zero_like

__all__ = ["kinds_of_scattering", "scatter_vertex", "scatter_vertices"]

_DIFFUSE, _SPECULAR, _METALLIC_ROUGHNESS, _CONDUCTOR, _RARE = (
    np.uintp(which) for which in (DIFFUSE, SPECULAR, METALLIC_ROUGHNESS, CONDUCTOR, RARE)
)
_RARE_SPECULAR = np.uint32(RARE_SPECULAR)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_WORLD = np.uint32(0)
_YES, _NO = np.bool_(True), np.bool_(False)
_NUMBER, _LIST = column(PathState, "number"), column(Shading, "list")
_SURVIVAL, _BRANCHES = column(Outcome, "survival"), column(Sample, "branches")
_PATHS = np.uintp(PATHS)


@device
def _material(scene, pool, rows, surface, options):
    """Returns the materials at the vertices of eight paths, with the fields that were looked up and stored by `shade_hits`."""
    n = surface.shading
    s, t = vec.basis(n)
    seen, uv1 = gather(pool, rows, Appearance), gather(pool, rows, Axes).uv1
    if scene.has.textures is not None:
        axes, n = gather(pool, rows, Axes), gather(pool, rows, Mapped).normal
        s, t = axes.s, axes.t
    time, wavelengths = time_of(scene.has.motion, pool, rows), path_wavelengths(scene, pool, rows, options)
    frame = s, t, n
    looked_up = seen.base, seen.metallic, seen.roughness, seen.eta, seen.uv, uv1
    return Material(surface.material, surface.front, *looked_up, surface.shading, frame, time, wavelengths)


@device
def _splitting(pool, lists, which):
    """Lists those paths of the list `which` that split at their vertex; returns the number of the list, which is NODES.

    NODES is not otherwise in use at this stage.
    """
    count = np.uintp(0)
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, NODES, count, path)
        specular = np.uint32(load_int(pool, at(path, _LIST))) == _RARE_SPECULAR
        count += np.uintp(splits(pool[at(path, _NUMBER)], specular))
    truncate(lists, NODES, count)
    return NODES


@device
def _copy_vertices(scene, pool, rows, stream, facet, shading):
    """Copies the vertices of paths that split to the pool rows of their second branches, which get new random numbers."""
    others = second_rows(pool, rows)
    own = gather(pool, rows, Sample)
    pixel = second_branch_stream(stream).pixel
    scatter(pool, others, Sample(pixel, own.number, own.place, own.x, own.y, own.time, own.start, own.branches))
    scatter(pool, others, gather(pool, rows, RowHit))
    scatter(pool, others, facet)
    scatter(pool, others, shading)
    if scene.has.textures is not None:
        scatter(pool, others, gather(pool, rows, Mapped))


@device
def _list_branches(pool, lists, which):
    """Adds to the list ACTIVE the second branch of each path on the list `which`, unless that branch has ended."""
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        if not (pool[at(path + _PATHS, _SURVIVAL)] <= _ZERO):  # NaN propagates, so the film can count it
            pool[at(path, _BRANCHES)] = _TWO
            append(lists, ACTIVE, path + _PATHS)


@template
def scatter_vertex(scene, pool, rows, answer, diffuse_lobe, is_lit, is_surface, options, lit, second):
    """Scatters the paths at the vertices in one row of the pool or in eight, which have one scattering model.

    Writes their next ray, and the shadow ray towards the sampled light. answer, diffuse_lobe: the functions of bsdfs.py for the
    vertices' materials. is_lit: None if light sampling finds nothing for them. is_surface: False in a medium. lit, second: as for
    `scatter_vertices`.
    """
    ray, path = gather(pool, rows, Ray), gather(pool, rows, PathState)
    none = zero_like(ray.pdf)
    if options.has_mattes:
        hit = gather(pool, rows, FirstHit)
        caught = (path.number == _ZERO) & (hit.caught > _ZERO)
        reflects = caught & not_(caught)
    facet, shading, to_light = gather(pool, rows, Facet), gather(pool, rows, Shading), gather(pool, rows, ChosenLight)
    surface = surface_of(pool, rows, facet, shading)
    m = _material(scene, pool, rows, surface, options)
    s, t, n = m.frame
    wo = vec.to_local(s, t, n, vec.neg(ray.d))
    wi = vec.to_local(s, t, n, to_light.direction)
    if second or not lit:
        wi = wo  # there is no light: any direction
    stream = streams_of(pool, rows, options)
    u = draw_scattering(stream, path.number)
    if second:
        u = second_branch_numbers(u)
    choose = u[2]
    if is_lit is not None and scene.has.targets is not None:
        here = last_vertex(scene, pool, rows)
        targets = targets_in_view(scene, here, m.material, shading.list == _RARE_SPECULAR, is_surface, options)
        chosen = aim(scene, here, targets, choose, (u[0], u[1]))
        choose = chosen.choose
    if is_lit is not None and scene.path_guide is not None:
        is_rare = shading.list == _RARE_SPECULAR
        guided = choose_guided(scene, facet.point, n, is_rare, is_surface, choose, (u[0], u[1]))
        choose = guided.choose
    f, scatter_pdf, on, weight, pdf, eta2 = answer(scene, m, wo, wi, choose, (u[0], u[1]))
    sample = BsdfSample(on, weight, pdf, eta2, none + _ONE)
    if is_lit is not None and scene.has.targets is not None:
        scatter_pdf = mixture_pdf(scene, here, targets, to_light.direction, scatter_pdf, none + NOT_AIMED)
        along, own_f, own_pdf = vec.to_local(s, t, n, chosen.direction), (none, none, none), none
        if any_of(chosen.is_aimed):
            own_f, own_pdf, _, _, _, _ = answer(scene, m, wo, along, choose, (u[0], u[1]))
        sample = aimed_sample(scene, here, targets, chosen, m.frame, sample, along, own_f, own_pdf)
    if is_lit is not None and scene.path_guide is not None:
        if lit and not second:
            scatter_pdf = guided_pdf(scene, guided, to_light.direction, scatter_pdf, none + NO_PORTAL)
        along, own_f, own_pdf = vec.to_local(s, t, n, guided.direction), (none, none, none), none
        if any_of(guided.is_guided):
            own_f, own_pdf, _, _, _, _ = answer(scene, m, wo, along, choose, (u[0], u[1]))
        inner_pdf = own_pdf
        if scene.has.targets is not None:
            inner_pdf = mixture_pdf(scene, here, targets, guided.direction, own_pdf, none + NOT_AIMED)
        sample = guided_sample(scene, guided, m.frame, sample, along, own_f, own_pdf, inner_pdf)
    reflected, value, to_sample = (none, none, none), (none, none, none), (none, none, none)
    if scene.has.visibility is not None or scene.has.light_paths is not None:
        reflected, value = diffuse_lobe(scene, m, wo, sample.wi), vec.scale(sample.weight, sample.pdf)
        if is_lit is not None and lit and not second:
            to_sample = diffuse_lobe(scene, m, wo, wi)
    if scene.has.visibility is not None:
        left = after_vertex(scene, stream, path.number, second, reflected, value, sample.wi, is_surface)
        reflected, value = left.diffuse, left.value
        sample = BsdfSample(sample.wi, vec.mul(sample.weight, left.factor), sample.pdf, sample.eta2, sample.unguided)
        if is_lit is not None and lit and not second:
            word = u32(to_int(gather(pool, rows, Outcome).is_cast))
            to_sample, f = visible_lobes(word, to_sample, f, wi, is_surface)
    if scene.has.light_paths is not None:
        first = spare_where_not(pool, path.number == _ZERO, second_rows(pool, rows) if second else rows)
        share = share_after_vertex(reflected, value, sample.wi, is_surface)
        store_share(pool, group_row(pool, first, options), options, share)
        if is_lit is not None and lit and not second:
            share = share_after_vertex(to_sample, f, wi, is_surface)
            store_sampled_share(pool, group_row(pool, first, options), options, share)
    branches = none + _ONE
    if is_lit is not None:
        branches = where(splits(path.number, shading.list == _RARE_SPECULAR), none + np.float32(options.splitting), branches)
    if scene.has.reflections is not None and options.has_mattes:
        reflects = catches_reflections(scene, caught, m.material)
        branches = where(caught, none + _ONE, branches)
    start, end, is_cast = (none, none, none), (none, none, none), none
    if is_lit is not None and lit and not second:
        light = LightSample(to_light.direction, gather(pool, rows, Outcome).end, to_light.radiance, to_light.pdf, none != none)
        share = light_weight(to_light.pdf, scatter_pdf, to_light.branches)
        if options.has_mattes:
            share = where(caught & not_(reflects), none + _ONE, share)  # a path ends there: light samples alone find its light
        medium_stack = as_wide(_WORLD, none)
        if scene.has.media is not None:
            medium_stack = gather(pool, rows, Crossings).medium_stack
        shadow = sample_direct_light(scene, surface, path, light, wi, f, share, medium_stack, is_surface)
        start, end, is_cast = shadow.start, shadow.end, where(shadow.is_cast, _ONE, none)
        if options.has_mattes:
            bright = where(shadow.is_cast, luminance_on_film(scene, stream, shadow.brought), none)
            scatter(pool, spare_where_not(pool, caught, rows), record_direct_light(hit, bright))
            if scene.has.reflections is not None:
                unshaded = ignores_shadows(scene, caught, m.material)
                white = none + _ONE, none + _ONE, none + _ONE
                arrives = add_direct_light(path.radiance, shadow.brought, white, shadow.segments, options)
                path = with_radiance(path, where3(unshaded & shadow.is_cast, arrives, path.radiance))
                is_cast = where(unshaded, none, is_cast)
        root = shadow.medium_stack  # unused
        if scene.has.visibility is not None:
            root = shadow_root_of(word)
        scatter(pool, rows, DirectLight(shadow.brought, shadow.segments, share, to_light.pdf, shadow.medium_stack, root))

    ray, path, bounce = scattering.scatter(surface, m.frame, ray, path, sample, branches, options)
    path, survival = continue_or_end(path, ray, u[3], is_surface, options)
    if options.has_mattes:
        survival = where(caught & not_(reflects), none, survival)
        if second:
            survival = where(caught, none, survival)
    written = rows
    if second:
        _copy_vertices(scene, pool, rows, stream, facet, shading)
        written = second_rows(pool, rows)
        path = with_radiance(path, (none, none, none))
    if scene.caustics is not None:
        specular = shading.list == _RARE_SPECULAR
        if is_lit is None:
            specular = none == none
        leave_with_chain(scene, pool, rows, written, specular, bounce, options)
    if scene.has.media is not None or options.has_depths:
        crossings = gather(pool, rows, Crossings)
        crossings = scattering.cross_surface(scene, surface, crossings, bounce, is_surface)
        if scene.has.visibility is not None:
            crossings = with_ray_kind(crossings, left.kind)
        scatter(pool, written, crossings)
    scatter(pool, written, ray)
    scatter(pool, written, path)
    scatter(pool, written, Outcome(start, end, is_cast, survival))


@template
def _scatter(scene, pool, lists, which, answer, diffuse_lobe, is_lit, is_surface, options, lit, second):
    """Scatters the paths at the vertices on one list, as `scatter_vertex` does."""
    taken = _splitting(pool, lists, which) if second else which
    for k in range(0, pad(lists, taken), 8):
        rows = eight_rows(lists, taken, k)
        scatter_vertex(scene, pool, rows, answer, diffuse_lobe, is_lit, is_surface, options, lit, second)
    if second:
        _list_branches(pool, lists, taken)


@subroutine
def _scatter_diffuse(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(scene, pool, lists, _DIFFUSE, eval_and_sample_diffuse, eval_diffuse_lobe_diffuse, True, _YES, options, lit, second)


@subroutine
def _scatter_specular(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(scene, pool, lists, _SPECULAR, eval_and_sample_specular, eval_no_lobe, None, _YES, options, lit, False)


@subroutine
def _scatter_metallic_roughness(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(
        scene,
        pool,
        lists,
        _METALLIC_ROUGHNESS,
        eval_and_sample_metallic_roughness,
        eval_diffuse_lobe_metallic_roughness,
        True,
        _YES,
        options,
        lit,
        second,
    )


@subroutine
def _scatter_conductor(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(scene, pool, lists, _CONDUCTOR, eval_and_sample_conductor, eval_no_lobe, True, _YES, options, lit, second)


@subroutine
def _scatter_rare(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(scene, pool, lists, _RARE, eval_and_sample_rare, eval_diffuse_lobe_rare, True, _YES, options, lit, second)


@subroutine
def _scatter_in_medium(scene, pool, lists, options, lit, second):
    never_inline()
    _scatter(scene, pool, lists, MEDIUM_VERTICES, eval_and_sample_in_medium, eval_no_lobe, True, _NO, options, lit, second)


@subroutine
def scatter_vertices(scene, pool, lists, options, lit, second):
    """Scatters the paths at all listed vertices: writes their next ray, and the shadow ray towards the sampled light.

    lit: whether light sampling can find anything in the scene. second: True to start only the second branches of paths that split
    at their vertex (steps/splitting.py).
    """
    never_inline()
    if scene.has.layers is not None and length(lists, _RARE) > 0:
        _scatter_rare(scene, pool, lists, options, lit, second)
    if scene.has.media is not None and length(lists, MEDIUM_VERTICES) > 0:
        _scatter_in_medium(scene, pool, lists, options, lit, second)
    if length(lists, _DIFFUSE) > 0:
        _scatter_diffuse(scene, pool, lists, options, lit, second)
    if length(lists, _SPECULAR) > 0 and not second:
        _scatter_specular(scene, pool, lists, options, lit, second)
    if length(lists, _METALLIC_ROUGHNESS) > 0:
        _scatter_metallic_roughness(scene, pool, lists, options, lit, second)
    if length(lists, _CONDUCTOR) > 0:
        _scatter_conductor(scene, pool, lists, options, lit, second)


def kinds_of_scattering(has: Any) -> list[Any]:
    """Returns the functions that `scatter_vertices` calls for scenes with these features, the slowest to compile first."""
    rare = [_scatter_rare] if has.layers is not None else []
    in_medium = [_scatter_in_medium] if has.media is not None else []
    return [*rare, *in_medium, _scatter_metallic_roughness, _scatter_conductor, _scatter_specular, _scatter_diffuse]
