"""For scenes with media: samples the free flights of the active paths, and creates their vertices in media."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import (
    ACTIVE,
    DONE,
    LIT,
    MEDIUM_VERTICES,
    MISSED,
    SPHERES,
    TRIANGLES,
    append,
    eight_rows,
    length,
    pad,
    put,
    row,
    truncate,
)
from renderer.kernel.backends.cpu.reflections import is_from_catcher, meet_objects
from renderer.kernel.backends.cpu.rows import (
    Appearance,
    Axes,
    Facet,
    Mapped,
    MediumFlight,
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
from renderer.kernel.light_groups import add_group_light, group_of_media
from renderer.kernel.light_paths import EMISSION, add_path_light
from renderer.kernel.material.material import Parameters
from renderer.kernel.medium.medium_stack import medium_albedo
from renderer.kernel.steps.continue_or_end import is_last
from renderer.kernel.steps.emitted_light import add_medium_light
from renderer.kernel.steps.medium_event import medium_event, medium_surface
from renderer.kernel.steps.record_first_hit import record_first_hit, with_albedo
from renderer.kernel.steps.state import Crossings, PathState, Ray, with_throughput
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.wide.values import any_of, as_wide, where, zero_like

__all__ = ["list_medium_vertices", "sample_free_flight", "sample_free_flights"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_SURFACE = np.uint32(0)  # replaces the object's number at surfaces; vertices in a medium have NO_OBJECT
_IN_MEDIUM, _OVER = np.uint32(MEDIUM_VERTICES), np.uint32(DONE)
_SCATTERS = column(MediumFlight, "scatters")


@device
def _store_vertices(pool, rows, surface, g, which):
    """Writes vertices in media to the paths' rows of the pool.

    g: mean cosine of the phase function at each vertex. which: number of the list on which the vertices will be scattered.
    """
    none = zero_like(g)
    one = none + _ONE
    n, black = surface.shading, (none, none, none)
    s, t = vec.basis(n)
    scatter(pool, rows, Facet(surface.point, surface.error, surface.geometric, surface.front, surface.smooth))
    scatter(pool, rows, Shading(n, surface.lift, surface.material, which))
    scatter(pool, rows, Appearance((one, one, one), none, g, one, surface.uv))
    scatter(pool, rows, Axes(s, t, surface.uv1))
    scatter(pool, rows, Mapped(n, black, as_wide(NO_OBJECT, none)))


@template
def sample_free_flight(scene, pool, rows, options):
    """Samples the free flights of the paths in one row of the pool or in eight, and updates their throughput.

    Writes MediumFlight, and the vertices of paths that scatter in a medium. Shading receives the list of each of these: DONE if
    the path ends there, else MEDIUM_VERTICES.
    """
    met, path, crossings = gather(pool, rows, RowHit), gather(pool, rows, PathState), gather(pool, rows, Crossings)
    stream = streams_of(pool, rows, options)
    ray, wavelengths = gather(pool, rows, Ray), path_wavelengths(scene, pool, rows, options)
    event = medium_event(scene, ray, path, crossings, met.t, stream, path.number + met.passed, wavelengths)
    if scene.has.grids is not None:
        path, light = add_medium_light(path, event.emitted, options)
        if scene.has.groups is not None:
            add_group_light(pool, group_row(pool, rows, options) + group_of_media(scene), light, path.number == path.number)
        if scene.has.light_paths is not None:
            first, always = group_row(pool, rows, options), path.number == path.number
            add_path_light(pool, first, options, light, path.number, EMISSION, always)
    none = zero_like(path.number)
    if scene.has.reflections is not None:
        meets = event.scatters & is_from_catcher(scene, pool, rows, path, options)
        last, time = last_vertex(scene, pool, rows), time_of(scene.has.motion, pool, rows)
        kind = crossings.ray_kind
        path = meet_objects(scene, pool, rows, meets, meets, ray, path, last, kind, time, wavelengths, options)
    if any_of(event.scatters):
        surface = medium_surface(ray, event.distance)
        first = event.scatters & (path.number == _ZERO)
        if any_of(first):
            start, black = gather(pool, rows, Sample).start, (none, none, none)
            material = Parameters(event.albedo, none, none + _ONE, none + _ONE)
            seen = record_first_hit(surface, material, black, event.distance, start)
            if scene.spectrum is not None:
                seen = with_albedo(seen, medium_albedo(scene, crossings.medium_stack))
            scatter(pool, spare_where_not(pool, first, rows), seen)
        last = is_last(path, crossings.counts, none != none, options) | (vec.maximum(event.throughput) <= _ZERO)
        which = where(last, _OVER, as_wide(_IN_MEDIUM, none))
        _store_vertices(pool, spare_where_not(pool, event.scatters, rows), surface, event.g, which)
    number = where(event.scatters, as_wide(NO_OBJECT, none), _SURFACE)
    scatter(pool, rows, RowHit(event.distance, met.u, met.v, met.primitive, met.instance, met.passed, number, none))
    scatter(pool, rows, with_throughput(path, event.throughput))
    scatter(pool, rows, MediumFlight(where(event.scatters, _ONE, none)))


@subroutine
def sample_free_flights(scene, pool, lists, options):
    """Samples the free flights of the active paths, as `sample_free_flight` does.

    Paths that scatter in a medium are removed from the lists of hits. They are added to the list DONE if they end at that vertex,
    else to MEDIUM_VERTICES.
    """
    never_inline()
    count = pad(lists, ACTIVE)
    for k in range(0, count, 8):
        sample_free_flight(scene, pool, eight_rows(lists, ACTIVE, k), options)
    _remove_drifting(pool, lists, MISSED)
    _remove_drifting(pool, lists, TRIANGLES)
    _remove_drifting(pool, lists, SPHERES)
    drifting = np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        drifts = pool[at(path, _SCATTERS)] != _ZERO
        over = drifts & (gather(pool, path, Shading).list == _OVER)
        put(lists, MEDIUM_VERTICES, drifting, path)
        drifting += np.uintp(drifts & (not over))
        if over:
            append(lists, DONE, path)
    truncate(lists, MEDIUM_VERTICES, drifting)


@device
def _remove_drifting(pool, lists, which):
    """Removes from the list `which` those paths that scatter in a medium before they reach their hit."""
    stays = np.uintp(0)
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, which, stays, path)
        stays += np.uintp(pool[at(path, _SCATTERS)] == _ZERO)
    truncate(lists, which, stays)


@subroutine
def list_medium_vertices(lists):
    """Adds the vertices in media to the list for light sampling (LIT). Called after `shade_hits`."""
    never_inline()
    for k in range(length(lists, MEDIUM_VERTICES)):
        append(lists, LIT, row(lists, MEDIUM_VERTICES, k))
