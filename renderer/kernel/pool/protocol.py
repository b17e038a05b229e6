"""The protocol of a path in the pool (integrators/record.py): of the only one, in the first row, when a sample is replayed."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel.integrators.record import EMITTED, record_light, record_miss, record_surface
from renderer.kernel.integrators.state import Path
from renderer.kernel.pool.lists import MISSED, length
from renderer.kernel.pool.rows import CARRIED, FRAME, HIT, PLACE, RAY
from renderer.kernel.pool.ways import three
from renderer.kernel.surface.surface import NO_LIGHT, Surface
from renderer.wide.values import u32

__all__ = ["first_row", "record_arrival"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NO_UV = (_ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)
_NOWHERE = (_ZERO, _ZERO, _ZERO)
_PASSED = HIT + np.uintp(5)


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
def first_row(pool):
    """What the first row's path has met before: (its row in the protocol, the surfaces among it that it passed)."""
    passed = pool[_PASSED]
    return np.int64(pool[CARRIED + np.uintp(7)] + passed), passed


@subroutine
def record_arrival(pool, lists, log, row, passed, before):
    """Where the path's ray ended, which has been looked at just now. row, passed: of `first_row`, before: the path's radiance,
    all three until then.
    """
    out_of_line()
    path = _path(pool, before)
    if length(lists, MISSED) > 0:
        record_miss(log, row, path)
    else:
        through = pool[_PASSED] != passed
        point = three(pool, RAY) if through else three(pool, PLACE)  # where it goes on from: beside what it passed
        record_surface(log, row, _surface(pool, point), through, pool[HIT], path)
    record_light(log, row, EMITTED, three(pool, CARRIED))
