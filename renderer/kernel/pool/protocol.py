"""The record of one path in the pool (integrators/record.py): of the path in the first row, when a sample is replayed."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.integrators.depths import NO_COUNTS, limit_of
from renderer.kernel.integrators.record import (
    ARRIVED,
    BROUGHT,
    EMITTED,
    LAMP_AT,
    LAMP_PDF,
    LAMP_SHARE,
    LIMIT,
    OWN_SHARE,
    SCATTERED,
    SURVIVAL,
    TIME,
    TOLD,
    record_light,
    record_medium,
    record_miss,
    record_surface,
)
from renderer.kernel.integrators.state import Path
from renderer.kernel.pool.lists import ACTIVE, DRIFTING, LIT, MISSED, SCATTERING, WITHIN, length, row
from renderer.kernel.pool.rows import CARRIED, COUNTS, FRAME, HIT, LAMP, LAYERS, PLACE, RAY, SAMPLE, SHADOW
from renderer.kernel.pool.ways import three
from renderer.kernel.surface.surface import NO_LIGHT, NO_OBJECT, Surface
from renderer.wide.values import u32

__all__ = ["followed", "record_arrival", "record_departure"]

_FIRST = np.uintp(0)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NO_UV = (_ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)
_NOWHERE = (_ZERO, _ZERO, _ZERO)
_PASSED = HIT + np.uintp(5)
_TIME = SAMPLE + np.uintp(5)


@device
def _path(pool, radiance):
    return Path(
        three(pool, RAY),
        three(pool, RAY + np.uintp(3)),
        three(pool, PLACE),
        three(pool, FRAME),
        pool[RAY + np.uintp(6)],
        three(pool, CARRIED + np.uintp(4)),
        radiance,
        pool[RAY + np.uintp(7)],
        np.int64(pool[CARRIED + np.uintp(3)]),
        NO_COUNTS,
        None,
    )


@device
def _surface(pool, point):
    return Surface(
        point,
        pool[PLACE + np.uintp(3)],
        three(pool, PLACE + np.uintp(4)),
        three(pool, FRAME),
        _NO_UV,
        True,
        u32(load_int(pool, FRAME + np.uintp(6))),
        NO_LIGHT,
        u32(load_int(pool, HIT + np.uintp(6))),
        _NO_UV,
        _WHITE,
        _NO_TANGENT,
        False,
        _NOWHERE,
    )


@device
def _is_on(lists, which):
    """Whether the first row is on a list."""
    found = False
    for k in range(length(lists, which)):
        found |= row(lists, which, k) == _FIRST
    return found


@device
def followed(pool, lists, log):
    """Returns (the first row's next row in the record, the number of surfaces it has passed through).

    The row is beyond the record's end if nothing is recorded, or the path has ended.
    """
    passed = pool[_PASSED]
    number = np.int64(pool[CARRIED + np.uintp(7)] + passed)
    if len(log) == 0 or not _is_on(lists, ACTIVE):
        number = len(log)
    return number, passed


@subroutine
def record_arrival(pool, lists, log, number, passed, before, options):
    """Records where the path's ray ended, after surfaces were processed.

    number, passed: from `followed`; before: the path's radiance before that.
    """
    out_of_line()
    path = _path(pool, before)
    if _is_on(lists, MISSED):
        record_miss(log, number, path)
    elif u32(load_int(pool, HIT + np.uintp(6))) == NO_OBJECT:
        record_medium(log, number, three(pool, PLACE), pool[HIT], path)
    else:
        through = pool[_PASSED] != passed
        point = vec.add(path.o, vec.scale(path.d, pool[HIT])) if through else three(pool, PLACE)
        record_surface(log, number, _surface(pool, point), through, pool[HIT], path)
    log[number, OWN_SHARE] = pool[HIT + np.uintp(7)]
    log[number, TIME] = pool[_TIME]
    log[number, TOLD] = ARRIVED
    if options.has_depths:
        counts = pool[COUNTS], pool[COUNTS + np.uintp(1)], pool[COUNTS + np.uintp(2)], pool[LAYERS]
        log[number, LIMIT] = limit_of(counts, options)
    record_light(log, number, np.int64(EMITTED), three(pool, CARRIED))


@subroutine
def record_departure(pool, lists, log, number, lit):
    """Records the light chosen for the vertex, and whether the path continues. lit: as in scatter.py."""
    out_of_line()
    scattered = False
    for which in range(SCATTERING):
        scattered |= _is_on(lists, which)
    scattered |= _is_on(lists, DRIFTING) or _is_on(lists, WITHIN)
    if scattered:
        log[number, TOLD] = SCATTERED
        log[number, SURVIVAL] = pool[SHADOW + np.uintp(7)]
        if lit and _is_on(lists, LIT):
            log[number, LAMP_SHARE] = pool[LAMP + np.uintp(4)]
            log[number, LAMP_PDF] = pool[LAMP + np.uintp(5)]
            for i in range(3):
                log[number, LAMP_AT + i] = pool[SHADOW + np.uintp(3 + i)]
                log[number, BROUGHT + i] = pool[LAMP + np.uintp(i)]
