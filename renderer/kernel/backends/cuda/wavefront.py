"""Kernels of a graphics card that take many paths through the pool's stages, a path a thread: a wavefront.

Paths are kept in rows as the processor's pool keeps them (renderer/kernel/backends/cpu/rows.py), column by column, so that
adjacent threads read adjacent numbers. A stage processes a list of rows, and appends each to the list of its next stage: vertices
of one scattering model are one list, so that threads of a warp do the same work. The order of a list differs from run to run;
the film is a sum of integers, on which order has no effect.

renderer/cuda/turns.py says which kernels are launched in which order; each takes a Wave and a thread's number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.rows import LAYER_SLOTS
from renderer.arrays.scene_features import SceneFeatures
from renderer.bvh.compressed_tree import STACK_DEPTH
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, SHADOW_REACH, Hit, any_hit, camera_root, closest_hit, shadow_root
from renderer.film import ALPHA_PLANES, CHANNELS, COLOR, SAMPLES
from renderer.jit import device, local_floats, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu import lists
from renderer.kernel.backends.cpu.bsdfs import (
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
from renderer.kernel.backends.cpu.camera_rays import start_path
from renderer.kernel.backends.cpu.caustics import add_caustic, sample_caustic
from renderer.kernel.backends.cpu.intersect import add_transmitted, add_unoccluded
from renderer.kernel.backends.cpu.lights import choose_light, numbers_for_light
from renderer.kernel.backends.cpu.media import sample_free_flight
from renderer.kernel.backends.cpu.rows import (
    ChosenLight,
    DirectLight,
    LightDescent,
    MediumFlight,
    Outcome,
    RowHit,
    Sample,
    Shading,
    camera_stream,
    column,
    gather,
    group_row,
    last_vertex,
    scatter,
    second_rows,
    time_of,
)
from renderer.kernel.backends.cpu.scattering import scatter_vertex
from renderer.kernel.backends.cpu.subsurface import enter_body
from renderer.kernel.backends.cpu.surfaces import shade_hit, shade_miss
from renderer.kernel.backends.cuda.atomics import add_atomically, reserve
from renderer.kernel.backends.cuda.local_zeros import local_zeros
from renderer.kernel.backends.scalar.first_hit import (
    FIRST_HIT_SLOTS,
    add_alpha,
    catches_light_alone,
    is_finite_first_hit,
    store_first_hit,
    store_record,
    store_shadow,
)
from renderer.kernel.backends.scalar.light import has_lights
from renderer.kernel.backends.scalar.tile import add_sample
from renderer.kernel.draft import draft_word, prepare_pixel, smooth_pixel
from renderer.kernel.light.lights import choose_sampled
from renderer.kernel.light_groups import forget_groups
from renderer.kernel.light_paths import add_sample_by_light
from renderer.kernel.material.material import factors_at
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.spectrum.light_planes import planes_to_rgb
from renderer.kernel.spectrum.wavelengths import to_rgb
from renderer.kernel.steps.record_first_hit import FirstHit
from renderer.kernel.steps.splitting import splits
from renderer.kernel.steps.state import Crossings, PathState, Ray
from renderer.kernel.surface.surface import surface_at
from renderer.prune_absent_features import where_present
from renderer.wide.values import lookup, u32

__all__ = ["ACTIVE", "BAD", "COUNTERS", "LISTS", "RAYS", "Wave", "kernels_of", "scattering_kernels"]

BAD, RAYS = 0, 1  # entries of `Wave.counters`: samples left out of the film, rays traced
_NEXT, _CAMERA_MEDIA = np.uintp(2), np.uintp(3)  # the next sample of the job to start, and the media that contain the camera
COUNTERS = 4
LISTS = lists.LISTS + 1
ACTIVE = int(lists.ACTIVE)
_BAD, _RAYS = np.uintp(BAD), np.uintp(RAYS)
_RED, _GREEN, _BLUE = (np.uintp(COLOR.start + channel) for channel in range(3))
_SAMPLES = np.uintp(SAMPLES)
_ACTIVE, _MISSED, _HIT, _LIT, _WAITING, _DONE = (
    np.uintp(which) for which in (lists.ACTIVE, lists.MISSED, lists.TRIANGLES, lists.LIT, lists.WAITING, lists.DONE)
)
_MEDIUM_VERTICES, _WITHIN = np.uintp(lists.MEDIUM_VERTICES), np.uintp(lists.SUBSURFACE_VERTICES)
_FREE = np.uintp(lists.LISTS)  # rows without a path
_DIFFUSE, _SPECULAR, _METALLIC_ROUGHNESS, _CONDUCTOR, _RARE = (
    np.uintp(which) for which in (lists.DIFFUSE, lists.SPECULAR, lists.METALLIC_ROUGHNESS, lists.CONDUCTOR, lists.RARE)
)
_TO_SPECULAR, _TO_RARE, _TO_RARE_SPECULAR = (np.uint32(which) for which in (lists.SPECULAR, lists.RARE, lists.RARE_SPECULAR))
_THROUGH, _ON, _IN_MEDIUM = (np.uint32(which) for which in (lists.PASSED, lists.ACTIVE, lists.MEDIUM_VERTICES))
_LIGHT_PDF, _BEHIND = column(ChosenLight, "pdf"), column(Crossings, "behind")
_LIGHT_BITS = np.uint32(0xFFFFFFFF)
_STACK = 2 * STACK_DEPTH
_PLANES = CHANNELS + ALPHA_PLANES
_SUMS = (_PLANES, 1, 1)
_ZERO, _ONE_F32, _INF = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
_NONE = np.uint32(0)
_ROOT = np.int32(0)
_ONE = np.int64(1)
_YES, _NO = np.bool_(True), np.bool_(False)


class Wave(NamedTuple):
    """The argument of the kernels: the samples of a tile to render, the arrays to which they are added, and the paths' rows."""

    scene: Any
    camera: Any
    options: Any
    batch: Any  # renderer/kernel/accumulate.py
    film: Any  # (planes, h, w) int64, added to, with planes of alpha if these are requested; its size is the tile's
    counters: Any  # (COUNTERS,) int64
    pool: Any  # (columns, 2 * paths) f32; the last row is the spare one, so that there are paths - 1 paths; behind them their
    # light by group and path, each row's as a whole (renderer/kernel/light_groups.py), and with CausticTables their CausticPath
    lists: Any  # (LISTS, 2 * paths) u32: numbers of rows
    lengths: Any  # (LISTS,) int64: of the lists
    branches: Any  # (paths,) int64: of each path, how many branches have not ended
    records: Any  # (samples, columns) u32: of each sample of each pixel, as in Output (renderer/kernel/accumulate.py), or no rows
    second: Any  # whether vertices are scattered into their second branches
    draft: Any  # (h, w) u32: the tile's draft (renderer/kernel/draft.py), or no rows
    draft_light: Any  # (2, h, w, LIGHT_VALUES) f32: the draft before it is encoded, and a smoothed copy, or no rows
    draft_guides: Any  # (h, w, GUIDE_VALUES) f32: what guides its smoothing, or no rows
    draft_gain: Any  # 2**exposure of the draft, float32
    draft_pass: Any  # number of the pass that `smooth_draft` does; for `encode_draft` that of the passes done, int64


@device
def _is_listed(job, which, thread):
    return thread < job.lengths[which]


@device
def _row(job, which, thread):
    """Returns the row number at index `thread` of a list, uint32."""
    return job.lists[which, np.uintp(thread)]


@device
def _append(job, which, row):
    """Appends a row number to a list."""
    place = reserve(job.lengths, np.uintp(which))
    job.lists[np.uintp(which), np.uintp(place)] = row


@subroutine
def free_rows(job, thread):
    """Lists all rows as free. Threads: paths - 1."""
    _append(job, _FREE, np.uint32(thread))


@subroutine
def find_camera_media(job, thread):
    """Finds the media in which paths begin. One thread; only in scenes with media."""
    stack, pixels = local_floats(_STACK), job.film.shape[1] * job.film.shape[2]
    job.counters[_CAMERA_MEDIA] = media_of_camera(job.scene, stack, job.camera, pixels * job.batch.count)


@device
def _forget_light_planes(job, path):
    """Sets the light by group and path of both branches of a path to 0."""
    pool, options = job.pool, job.options
    forget_groups(pool, group_row(pool, path, options), options.group_rows)
    forget_groups(pool, group_row(pool, second_rows(pool, path), options), options.group_rows)


@subroutine
def start_paths(job, thread):
    """Starts the job's next samples in free rows; those that are left over are not listed again. Threads: paths."""
    batch, film = job.batch, job.film
    width, pixels = film.shape[2], film.shape[1] * film.shape[2]
    number = job.counters[_NEXT] + thread
    if _is_listed(job, _FREE, thread) and number < pixels * batch.count:
        row = _row(job, _FREE, thread)
        place = number % pixels
        x, y, sample = batch.x + place % width, batch.y + place // width, batch.first + number // pixels
        scatter(job.pool, row, Sample(_NONE, u32(sample), u32(place), u32(x), u32(y), _ZERO, _ZERO, _ZERO))
        if job.scene.has.media is None:
            start_path(job.pool, row, job.camera, job.options, job.scene.has.motion, None)
        else:
            medium_stack = u32(job.counters[_CAMERA_MEDIA])
            start_path(job.pool, row, job.camera, job.options, job.scene.has.motion, medium_stack)
        if job.scene.has.by_light is not None:
            _forget_light_planes(job, row)
        job.branches[row] = _ONE
        _append(job, _ACTIVE, row)


@subroutine
def begin_turn(job, thread):
    """Empties the lists for the stages of a turn. One thread."""
    job.counters[_NEXT] += job.lengths[_FREE]
    job.counters[_RAYS] += job.lengths[_ACTIVE] + job.lengths[_WAITING]
    active = job.lengths[_ACTIVE]
    for which in range(LISTS):
        job.lengths[which] = 0
    job.lengths[_ACTIVE] = active


@subroutine
def trace_rays(job, thread):
    """Finds what the active paths' rays hit. Threads: 2 * paths."""
    if _is_listed(job, _ACTIVE, thread):
        scene, pool, row = job.scene, job.pool, _row(job, _ACTIVE, thread)
        stack = local_floats(_STACK)
        ray, met = gather(pool, row, Ray), gather(pool, row, RowHit)
        root = camera_root(scene.bvh) if gather(pool, row, PathState).number == _ZERO else _ROOT
        after = where_present(scene.has.textures, FROM_ORIGIN)
        if scene.has.textures is not None and gather(pool, row, Shading).list == _THROUGH:
            after = met.t, np.int32(met.instance), np.int32(met.primitive)
        if scene.has.visibility is not None:
            root = lookup(scene.bvh.ray_roots, gather(pool, row, Crossings).ray_kind)
        if scene.has.media is not None:
            pool[_BEHIND, row] = after[0]
        hit = closest_hit(scene.bvh, stack, ray.o, ray.d, _INF, time_of(scene.has.motion, pool, row), root, after)
        found = RowHit(hit.t, hit.u, hit.v, u32(hit.primitive), u32(hit.instance), met.passed, met.object, met.weight)
        scatter(pool, row, found)
        if scene.has.media is None:
            _append(job, _MISSED if hit.primitive == NO_PRIMITIVE else _HIT, row)


@subroutine
def sample_free_flights(job, thread):
    """Samples the free flights of the active paths, and lists those that reach their hit. Threads: 2 * paths; only with media."""
    if _is_listed(job, _ACTIVE, thread):
        pool, row = job.pool, _row(job, _ACTIVE, thread)
        sample_free_flight(job.scene, pool, row, job.options)
        if gather(pool, row, MediumFlight).scatters == _ZERO:
            hit = np.int32(gather(pool, row, RowHit).primitive)
            _append(job, _MISSED if hit == NO_PRIMITIVE else _HIT, row)
        else:
            into = gather(pool, row, Shading).list
            if into == _IN_MEDIUM:
                _append(job, _LIT, row)
            _append(job, into, row)


@subroutine
def end_rays(job, thread):
    """Empties the list of the active paths, which the scattering fills. One thread."""
    job.lengths[_ACTIVE] = 0


@subroutine
def shade_misses(job, thread):
    """Adds environment and sun light to paths that hit nothing. Threads: 2 * paths."""
    if _is_listed(job, _MISSED, thread):
        row = _row(job, _MISSED, thread)
        shade_miss(job.scene, job.pool, row, job.options, _NO)
        _append(job, _DONE, row)


@device
def _find_surface(scene, which, o, d, hit):
    return surface_at(scene, o, d, Hit(hit.t, np.int32(hit.primitive), hit.u, hit.v, np.int32(hit.instance), hit.time))


@subroutine
def shade_hits(job, thread):
    """Adds emission of the surfaces that paths hit, and lists each path by its scattering model. Threads: 2 * paths."""
    if _is_listed(job, _HIT, thread):
        row = _row(job, _HIT, thread)
        shade_hit(job.scene, job.pool, row, _HIT, _find_surface, factors_at, job.options, _NO)
        into = gather(job.pool, row, Shading).list
        if job.scene.has.layers is not None and into == _TO_RARE_SPECULAR:
            job.pool[_LIGHT_PDF, row] = _ZERO  # no light
            into = _TO_RARE
        elif into <= _TO_RARE and into != _TO_SPECULAR:
            _append(job, _LIT, row)
        if job.scene.has.textures is not None and into == _THROUGH:
            into = _ON
        _append(job, into, row)


@subroutine
def trace_subsurface(job, thread):
    """Walks below surfaces with subsurface scattering, and lists each path by its scattering model. Threads: 2 * paths."""
    if _is_listed(job, _WITHIN, thread):
        row, stack, layers = _row(job, _WITHIN, thread), local_floats(_STACK), local_floats(LAYER_SLOTS)
        into = enter_body(job.scene, stack, job.pool, row, layers, job.options)
        if into != _DONE:
            _append(job, _LIT, row)
        _append(job, into, row)


@subroutine
def sample_caustics(job, thread):
    """Samples the light of small lamps through casters at vertices. Threads: 2 * paths; only with CausticTables."""
    if _is_listed(job, _LIT, thread):
        stack, layers, spare = local_floats(_STACK), local_floats(LAYER_SLOTS), local_floats(LAYER_SLOTS)
        rays = sample_caustic(job.scene, stack, job.pool, _row(job, _LIT, thread), layers, spare, job.options)
        add_atomically(job.counters, _RAYS, np.int64(rays))


@subroutine
def choose_lights(job, thread):
    """Samples a light for each vertex that can use light sampling. Threads: 2 * paths."""
    if _is_listed(job, _LIT, thread):
        scene, pool, row = job.scene, job.pool, _row(job, _LIT, thread)
        by_tree = False
        if scene.has.lights is not None:
            by_tree = len(scene.light_node) > 0
            if by_tree:
                u, v, choice = numbers_for_light(pool, row, job.options)
                vertex = last_vertex(scene, pool, row)
                light, chance = choose_sampled(scene, vertex.point, vertex.normal, choice)
                scatter(pool, row, LightDescent(_ZERO, chance, u32(light) ^ _LIGHT_BITS, u, v, choice))
        choose_light(scene, pool, row, by_tree, job.options)


@template
def _scatter(job, thread, which, answer, diffuse_lobe, is_lit, is_surface):
    """Scatters the path at a vertex on list `which`, or starts its second branch.

    answer, diffuse_lobe, is_lit, is_surface: as for `scatter_vertex`.
    """
    if _is_listed(job, which, thread):
        pool, row, second = job.pool, _row(job, which, thread), job.second
        is_rare_specular = gather(pool, row, Shading).list == _TO_RARE_SPECULAR
        if splits(gather(pool, row, PathState).number, is_rare_specular) or not second:
            lit = has_lights(job.scene)
            scatter_vertex(job.scene, pool, row, answer, diffuse_lobe, is_lit, is_surface, job.options, lit, second)
            written = second_rows(pool, row) if second else row
            outcome = gather(pool, written, Outcome)
            goes_on = not (outcome.survival <= _ZERO)  # NaN propagates, so the film can count it
            if outcome.is_cast != _ZERO:
                _append(job, _WAITING, written)
            if goes_on:
                _append(job, _ACTIVE, written)
            if goes_on and second:
                job.branches[row] = 2
            if not (goes_on or second):
                _append(job, _DONE, written)


@subroutine
def scatter_diffuse(job, thread):
    """Scatters paths at Lambertian vertices. Threads, as for all of these: 2 * paths."""
    _scatter(job, thread, _DIFFUSE, eval_and_sample_diffuse, eval_diffuse_lobe_diffuse, True, _YES)


@subroutine
def scatter_specular(job, thread):
    """Scatters paths at mirrors, smooth glass and smooth conductors, which do not split."""
    _scatter(job, thread, _SPECULAR, eval_and_sample_specular, eval_no_lobe, None, _YES)


@subroutine
def scatter_metallic_roughness(job, thread):
    """Scatters paths at vertices of the metallic-roughness model."""
    answer, lobe = eval_and_sample_metallic_roughness, eval_diffuse_lobe_metallic_roughness
    _scatter(job, thread, _METALLIC_ROUGHNESS, answer, lobe, True, _YES)


@subroutine
def scatter_conductor(job, thread):
    """Scatters paths at rough conductors."""
    _scatter(job, thread, _CONDUCTOR, eval_and_sample_conductor, eval_no_lobe, True, _YES)


@subroutine
def scatter_rare(job, thread):
    """Scatters paths at materials of many properties."""
    _scatter(job, thread, _RARE, eval_and_sample_rare, eval_diffuse_lobe_rare, True, _YES)


@subroutine
def scatter_in_medium(job, thread):
    """Scatters paths at vertices in media."""
    _scatter(job, thread, _MEDIUM_VERTICES, eval_and_sample_in_medium, eval_no_lobe, True, _NO)


@subroutine
def trace_shadow_rays(job, thread):
    """Adds the light of shadow rays that nothing occludes. Threads: 2 * paths."""
    if _is_listed(job, _WAITING, thread):
        scene, pool, row = job.scene, job.pool, _row(job, _WAITING, thread)
        stack = local_floats(_STACK)
        if scene.has.textures is not None and job.options.transparent:
            add_transmitted(scene, stack, pool, row, job.options)
        else:
            ray, time = gather(pool, row, Outcome), time_of(scene.has.motion, pool, row)
            way = vec.sub(ray.end, ray.start)
            root = shadow_root(scene.bvh)
            if scene.has.visibility is not None:
                root = lookup(scene.bvh.ray_roots, gather(pool, row, DirectLight).root)
            occluded = any_hit(scene.bvh, stack, ray.start, way, SHADOW_REACH, time, root)
            add_unoccluded(scene, pool, row, occluded, job.options)


@subroutine
def add_caustics(job, thread):
    """Adds the light through casters to the paths at vertices. Threads: 2 * paths; only with CausticTables."""
    if _is_listed(job, _LIT, thread):
        add_caustic(job.pool, _row(job, _LIT, thread), job.options)


@subroutine
def end_paths(job, thread):
    """Adds paths of which all branches have ended to the film, and frees their rows. Threads: 2 * paths."""
    if _is_listed(job, _DONE, thread):
        pool, batch, row = job.pool, job.batch, _row(job, _DONE, thread)
        path = row % np.uint32(len(job.branches))
        if add_atomically(job.branches, np.uintp(path), -_ONE) == _ONE:
            _add_to_film(job, pool, batch, path)
            _append(job, _FREE, path)


@device
def _add_to_film(job, pool, batch, path):
    """Adds a path to the film, or counts it as bad if it is not finite."""
    hit, sums = local_floats(FIRST_HIT_SLOTS), local_zeros(np.int64, _SUMS)
    store_first_hit(hit, gather(pool, path, FirstHit))
    radiance = _radiance(job, path)
    if vec.is_finite(radiance) and is_finite_first_hit(hit):
        sample = gather(pool, path, Sample)
        caught = job.options.has_mattes and catches_light_alone(hit)
        if caught:  # a shadow is black
            store_shadow(hit, radiance)
            radiance = vec.sub(radiance, radiance)
        add_sample(sums, 0, 0, np.int64(sample.number), radiance, hit, job.options.scale, batch.origin)
        if job.options.transparent_background:
            add_alpha(sums, 0, 0, hit, job.options.scale)
        pixels, behind = job.film.shape[1] * job.film.shape[2], 0
        if job.scene.has.by_light is not None:
            behind = 3 * (np.int64(job.options.groups) + np.int64(job.options.paths))
            if not caught:
                _add_light_planes(job, path, sample.place, radiance)
        for plane in range(_PLANES):
            value = sums[plane, 0, 0]
            if value != 0:
                place = plane if plane < CHANNELS else plane + behind  # those of alpha are the film's last
                add_atomically(job.film, np.uintp(place * pixels + sample.place), value)
        if len(job.records) > 0:
            number = np.int64(sample.place) * batch.count + np.int64(sample.number) - batch.first
            store_record(job.records, np.uintp(number), hit, radiance)
    else:
        add_atomically(job.counters, _BAD, _ONE)


@device
def _radiance(job, path):
    """Returns the radiance of both branches of a path, linear Rec.709."""
    second = gather(job.pool, second_rows(job.pool, path), PathState).radiance
    first = gather(job.pool, path, PathState).radiance
    if job.scene.spectrum is not None:
        stream = camera_stream(gather(job.pool, path, Sample), job.options)
        first, second = to_rgb(job.scene.spectrum, stream, first), to_rgb(job.scene.spectrum, stream, second)
    return vec.add(first, second)


@device
def _add_light_planes(job, path, place, radiance):
    """Adds a path's light by group and path to the planes of its pixel. place: of the pixel. radiance: the path's."""
    pool, options, pixels = job.pool, job.options, np.uintp(job.film.shape[1] * job.film.shape[2])
    rows = group_row(pool, path, options), group_row(pool, second_rows(pool, path), options)
    if job.scene.spectrum is not None:
        stream = camera_stream(gather(pool, path, Sample), options)
        planes_to_rgb(job.scene.spectrum, stream, pool, rows[0], options)
        planes_to_rgb(job.scene.spectrum, stream, pool, rows[1], options)
    plane, counts = np.uintp(CHANNELS) * pixels + np.uintp(place), (options.groups, options.paths)
    add_sample_by_light(job.film, plane, pixels, pool, rows, counts, radiance, options.scale, add_atomically)


@subroutine
def prepare_draft(job, thread):
    """Writes light and guides of the film's draft. Threads: pixels of the tile; after the paths, and only for a draft."""
    width = job.draft.shape[1]
    if thread < len(job.draft) * width:
        y, x = np.uintp(thread // width), np.uintp(thread % width)
        prepare_pixel(job.film, job.draft_light, job.draft_guides, y, x, _ONE_F32 / job.options.scale, job.draft_gain)


@subroutine
def smooth_draft(job, thread):
    """Takes one pass of the draft's filter. Threads: pixels of the tile."""
    width = job.draft.shape[1]
    if thread < len(job.draft) * width:
        smooth_pixel(job.draft_light, job.draft_guides, thread // width, thread % width, job.draft_pass)


@subroutine
def encode_draft(job, thread):
    """Writes the draft. Threads: pixels of the tile."""
    width = job.draft.shape[1]
    if thread < len(job.draft) * width:
        y, x, half = np.uintp(thread // width), np.uintp(thread % width), job.draft_pass & 1
        job.draft[y, x] = draft_word(job.film, job.draft_light, half, y, x, _ONE_F32 / job.options.scale)


_KERNELS = (
    free_rows,
    start_paths,
    begin_turn,
    trace_rays,
    end_rays,
    shade_misses,
    shade_hits,
    choose_lights,
    trace_shadow_rays,
    end_paths,
    prepare_draft,
    smooth_draft,
    encode_draft,
)
_IN_MEDIA = find_camera_media, sample_free_flights, trace_subsurface
_OF_CAUSTICS = sample_caustics, add_caustics


def kernels_of(has: SceneFeatures, caustics: bool = False) -> dict[str, Callable[..., Any]]:
    """Returns the kernels for scenes with these features, by name. caustics: whether they have CausticTables."""
    in_media = _IN_MEDIA if has.media is not None else ()
    through_casters = _OF_CAUSTICS if caustics else ()
    return {each.__name__: each for each in (*_KERNELS, *in_media, *through_casters, *_scattering(has))}


def scattering_kernels(has: SceneFeatures) -> tuple[list[str], list[str]]:
    """Returns the names of the kernels that scatter paths: of those whose vertices may split, and of the others."""
    splitting, others = [each.__name__ for each in _scattering(has)], [scatter_specular.__name__]
    return [name for name in splitting if name not in others], others


def _scattering(has: SceneFeatures) -> list[Callable[..., Any]]:
    rare = [scatter_rare] if has.layers is not None else []
    in_medium = [scatter_in_medium] if has.media is not None else []
    return [scatter_diffuse, scatter_metallic_roughness, scatter_conductor, scatter_specular, *rare, *in_medium]
