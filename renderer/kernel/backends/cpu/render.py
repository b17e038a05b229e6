"""Renders a batch with a pool of paths.

Each stage processes all rows of the pool that are ready for it. Terminated paths free their rows for new ones.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from numba import typeof, types

from renderer.bvh.traverse import new_stack
from renderer.jit import template
from renderer.kernel.backends.cpu.accumulate_film import SUMS, accumulate_film, flush_film
from renderer.kernel.backends.cpu.camera_rays import NextSample, start_paths
from renderer.kernel.backends.cpu.caustics import add_caustics, sample_caustics
from renderer.kernel.backends.cpu.intersect import intersect_closest, resolve_shadow_rays, trace_shadow_rays
from renderer.kernel.backends.cpu.lights import choose_lights
from renderer.kernel.backends.cpu.lists import ACTIVE, DONE, LIST_SIZE, LISTS, append, clear, length
from renderer.kernel.backends.cpu.media import list_medium_vertices, sample_free_flights
from renderer.kernel.backends.cpu.path_trace import next_record_row, radiance_of, record_arrival, record_departure
from renderer.kernel.backends.cpu.rows import PATHS, ROW, ROWS, caustic_floats, group_floats, line_floats
from renderer.kernel.backends.cpu.scattering import kinds_of_scattering, scatter_vertices
from renderer.kernel.backends.cpu.spectrum_to_rgb import spectrum_to_rgb
from renderer.kernel.backends.cpu.subsurface import trace_subsurface
from renderer.kernel.backends.cpu.surfaces import shade_hits, shade_misses
from renderer.kernel.backends.cpu.traversal_state import new_stacks
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.path_trace import DIRECT, record_light, record_second_branch
from renderer.prune_absent_features import where_present

__all__ = ["Part", "Pool", "pool_for", "render_with_pool", "stages"]

Part = tuple[Any, tuple[types.Type, ...]]  # a subroutine, and the types that it is called with

_ZERO = np.float32(0.0)
_BRANCHES, _SCATTERS = np.bool_(True), np.bool_(False)  # not literals, for which Numba would compile each stage again


class Pool(NamedTuple):
    """The scratch memory for rendering a batch: the rows of the paths, lists of rows, traversal stacks, and the pixels' sums."""

    alone: Any  # traversal stack of a single ray
    stack: Any  # traversal stacks of all rows: traversal_state.py
    rows: Any  # ((ROWS + 1) * ROW,) f32: rows.py; behind them the light by group, and at the end of it what caustics need
    lists: Any  # (LISTS * LIST_SIZE,) u32: lists.py
    film: Any  # (pixels * SUMS,) i64, zeros before and after: accumulate_film.py; behind them the sums by group


_kept = threading.local()


def pool_for(width: int, height: int, planes: int = 0, rows: int = 0) -> Pool:
    """Returns the scratch memory for a batch of a tile of width x height pixels: this thread's last one if that is large enough.

    planes: number of light groups and paths with planes in the film. rows: from `group_rows` (options.py).

    Reuse matters: the system clears new memory page by page, which takes as long as rendering one sample per pixel.
    """
    pool: Pool | None = getattr(_kept, "pool", None)
    sums, floats = width * height * (SUMS + 3 * planes), (ROWS + 1) * int(ROW) + group_floats(rows) + caustic_floats()
    if pool is None or len(pool.film) < sums or len(pool.rows) < floats:
        film, memory = np.zeros(sums, np.int64), line_floats(floats)
        pool = _kept.pool = Pool(new_stack(), new_stacks(), memory, np.zeros(LISTS * LIST_SIZE, np.uint32), film)
    return pool


@template
def render_with_pool(scene, pool, camera, options, batch, output):
    """Renders a batch with the pool of paths; returns (number of bad samples, number of rays)."""
    paths, lists, log = pool.rows, pool.lists, output.log
    height, width = output.sums.shape[1], output.sums.shape[2]
    lit = scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0
    bad_count = rays = np.int64(0)
    for which in range(LISTS):
        clear(lists, which)
    for k in range(PATHS):
        append(lists, DONE, k)
    following = NextSample(np.int64(0), np.int64(0), np.int64(batch.first))
    samples = width * height * batch.count
    medium_stack = where_present(scene.has.media, media_of_camera(scene, pool.alone, camera, samples))
    begin = np.uintp(width * height * SUMS)
    by_group = where_present(scene.has.by_light, (options.groups, options.paths, options.group_rows, begin))
    while samples > 0:
        following = start_paths(paths, lists, following, width, height, camera, options, batch, scene.has.motion, medium_stack)
        if length(lists, ACTIVE) == 0:
            break
        clear(lists, DONE)
        row, passed = next_record_row(paths, lists, log)
        before = radiance_of(paths, 0)
        rays += length(lists, ACTIVE)
        intersect_closest(scene, pool.alone, pool.stack, paths, lists)
        if scene.has.media is not None:
            sample_free_flights(scene, paths, lists, options)
        shade_misses(scene, paths, lists, options, len(log) > 0)
        shade_hits(scene, paths, lists, options, len(log) > 0)
        if row < len(log):
            record_arrival(paths, lists, log, row, passed, before, options)
        if scene.has.media is not None:
            list_medium_vertices(lists)
            trace_subsurface(scene, pool.alone, paths, lists, options)
        if scene.caustics is not None:
            rays += sample_caustics(scene, pool.alone, paths, lists, options)
        if lit:
            choose_lights(scene, paths, lists, options)
        clear(lists, ACTIVE)
        if options.splitting > 1:
            scatter_vertices(scene, paths, lists, options, lit, _BRANCHES)
        scatter_vertices(scene, paths, lists, options, lit, _SCATTERS)
        rays += trace_shadow_rays(scene, pool.alone, pool.stack, paths, lists, options)
        if scene.caustics is not None:
            add_caustics(paths, lists, options)
        if row < len(log):
            record_light(log, row, DIRECT, radiance_of(paths, 0))
            record_departure(paths, lists, log, row, lit)
        if scene.spectrum is not None:
            spectrum_to_rgb(scene, paths, lists, options)
        bad_count = accumulate_film(
            paths, lists, pool.film, options.scale, width, batch, output.bad, bad_count, by_group, output.records
        )
    record_second_branch(log, radiance_of(paths, PATHS))
    flush_film(pool.film, output.sums, options.scale, options.transparent_background)
    return bad_count, rays


def stages(
    has: Any, caustics: Any, scene: types.Type, pool: Pool, camera: Any, options: Any, batch: Any, output: Any
) -> list[Part]:
    """Returns the functions that `render_with_pool` calls, with argument types, for compilation in any order; the slowest first.

    has: the features of the scene. caustics: its CausticTables, or None. scene: the type of a reference to it.
    """
    alone, stack, paths, lists, film = map(typeof, pool)
    view, asked, wanted, lit = typeof(camera), typeof(options), typeof(batch), types.boolean
    following = typeof(NextSample(np.int64(0), np.int64(0), np.int64(0)))
    in_media = (
        [(sample_free_flights, (scene, paths, lists, asked)), (trace_subsurface, (scene, alone, paths, lists, asked))]
        if has.media
        else []
    )
    through_casters = [(sample_caustics, (scene, alone, paths, lists, asked))] if caustics is not None else []
    medium_stack = types.uint32 if has.media else types.none
    bad, scale, number = typeof(output.bad), typeof(options.scale), types.int64
    by_group = types.none
    if has.by_light:
        by_group = typeof((options.groups, options.paths, options.group_rows, np.uintp(0)))
    scattering = [(each, (scene, paths, lists, asked, lit, lit)) for each in kinds_of_scattering(has)]
    return [
        *through_casters,
        (shade_hits, (scene, paths, lists, asked, lit)),
        (intersect_closest, (scene, alone, stack, paths, lists)),
        *scattering,
        *in_media,
        (choose_lights, (scene, paths, lists, asked)),
        (shade_misses, (scene, paths, lists, asked, lit)),
        (resolve_shadow_rays, (scene, alone, stack, paths, lists, asked)),
        (trace_shadow_rays, (scene, alone, stack, paths, lists, asked)),
        (start_paths, (paths, lists, following, number, number, view, asked, wanted, typeof(has.motion), medium_stack)),
        (accumulate_film, (paths, lists, film, scale, number, wanted, bad, number, by_group, typeof(output.records))),
    ]
