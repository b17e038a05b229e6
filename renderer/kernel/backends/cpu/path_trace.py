"""Records the path in the pool's first row when a sample is replayed; format: renderer/kernel/path_trace.py."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import ACTIVE, LIT, MEDIUM_VERTICES, MISSED, SCATTERING, SUBSURFACE_VERTICES, length, row
from renderer.kernel.backends.cpu.rows import (
    DirectLight,
    Facet,
    Outcome,
    RowHit,
    Sample,
    Shading,
    gather,
    surface_of,
)
from renderer.kernel.path_trace import (
    ARRIVED,
    BROUGHT,
    EMISSION_WEIGHT,
    EMITTED,
    LIGHT_AT,
    LIGHT_PDF,
    LIGHT_WEIGHT,
    LIMIT,
    RECORDED,
    SCATTERED,
    SURVIVAL,
    TIME,
    record_light,
    record_medium,
    record_miss,
    record_surface,
)
from renderer.kernel.steps.depths import limit_of
from renderer.kernel.steps.state import Crossings, PathState, Ray, with_radiance
from renderer.kernel.surface.surface import NO_OBJECT

__all__ = ["next_record_row", "radiance_of", "record_arrival", "record_departure"]

_FIRST = np.uintp(0)


@device
def _is_on(lists, which):
    """Returns True if the path in the pool's first row is on list `which`."""
    found = False
    for k in range(length(lists, which)):
        found |= row(lists, which, k) == _FIRST
    return found


@device
def radiance_of(pool, row):
    """Returns the radiance that the path in a row of the pool has gathered so far."""
    return gather(pool, np.uintp(row), PathState).radiance


@device
def next_record_row(pool, lists, log):
    """Returns (row of the record for the path's next hit, number of surfaces that the path has passed through so far).

    The row is beyond the record's end if nothing is to be recorded, or if the path has ended.
    """
    passed = gather(pool, _FIRST, RowHit).passed
    number = np.int64(gather(pool, _FIRST, PathState).number + passed)
    if len(log) == 0 or not _is_on(lists, ACTIVE):
        number = len(log)
    return number, passed


@subroutine
def record_arrival(pool, lists, log, number, passed, before, options):
    """Records in `log` what the ray of the recorded path has hit. Called after `shade_hits`.

    number, passed: from `next_record_row`. before: the path's radiance before `shade_misses`.
    """
    never_inline()
    ray, met, path = gather(pool, _FIRST, Ray), gather(pool, _FIRST, RowHit), gather(pool, _FIRST, PathState)
    arrived = with_radiance(path, before)
    if _is_on(lists, MISSED):
        record_miss(log, number, ray, arrived)
    elif met.object == NO_OBJECT:
        record_medium(log, number, gather(pool, _FIRST, Facet).point, met.t, ray, arrived)
    else:
        surface, through = (
            surface_of(pool, _FIRST, gather(pool, _FIRST, Facet), gather(pool, _FIRST, Shading)),
            met.passed != passed,
        )
        point = vec.add(ray.o, vec.scale(ray.d, met.t)) if through else surface.point
        record_surface(log, number, surface, point, through, met.t, ray, arrived)
    log[number, EMISSION_WEIGHT] = met.weight
    log[number, TIME] = gather(pool, _FIRST, Sample).time
    log[number, RECORDED] = ARRIVED
    if options.has_depths:
        log[number, LIMIT] = limit_of(gather(pool, _FIRST, Crossings).counts, options)
    record_light(log, number, EMITTED, path.radiance)


@subroutine
def record_departure(pool, lists, log, number, lit):
    """Records in row `number` of `log` the light sampled at the recorded path's vertex, and the path's survival probability.

    lit: whether light sampling can find anything in the scene.
    """
    never_inline()
    scattered = False
    for which in range(SCATTERING):
        scattered |= _is_on(lists, which)
    scattered |= _is_on(lists, MEDIUM_VERTICES) or _is_on(lists, SUBSURFACE_VERTICES)
    if scattered:
        outcome = gather(pool, _FIRST, Outcome)
        log[number, RECORDED] = SCATTERED
        log[number, SURVIVAL] = outcome.survival
        if lit and _is_on(lists, LIT):
            light = gather(pool, _FIRST, DirectLight)
            log[number, LIGHT_WEIGHT] = light.weight
            log[number, LIGHT_PDF] = light.pdf
            for i in range(3):
                log[number, LIGHT_AT + i] = outcome.end[i]
                log[number, BROUGHT + i] = light.brought[i]
