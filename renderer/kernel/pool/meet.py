"""Stage 1: what each path's ray meets first. Rays are traced one by one: their ways through the tree part too soon."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import store_int
from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.integrators.transport import limited
from renderer.kernel.integrators.visibility import transmittance
from renderer.kernel.pool.lists import (
    ACTIVE,
    DONE,
    MISSED,
    PASSED,
    SCATTERING,
    SPHERES,
    TRIANGLES,
    append,
    clear,
    length,
    row,
)
from renderer.kernel.pool.rows import CARRIED, HIT, LAMP, RAY, SHADOW, at, time_of

__all__ = ["floats3", "meet", "see_lights"]

_ZERO = np.float32(0.0)
_INF = np.float32(np.inf)
_1, _2 = np.uintp(1), np.uintp(2)
_D = RAY + np.uintp(3)
_U, _V, _PRIMITIVE, _INSTANCE = (HIT + np.uintp(k) for k in (1, 2, 3, 4))
_SEGMENTS = LAMP + np.uintp(3)
_END, _WAITS, _GOES_ON = SHADOW + np.uintp(3), SHADOW + np.uintp(6), SHADOW + np.uintp(7)


@device
def floats3(pool, place):
    """A vector at a flat place of the pool."""
    return pool[place], pool[place + _1], pool[place + _2]


@subroutine
def meet(scene, stack, pool, lists):
    """Traces the active paths' rays, and lists the paths by what they met."""
    out_of_line()
    for which in (MISSED, TRIANGLES, SPHERES):
        clear(lists, which)
    triangles = len(scene.triangle)
    for k in range(length(lists, ACTIVE)):
        path = row(lists, ACTIVE, k)
        time = time_of(scene.has.motion, pool, path)
        hit = closest_hit(scene.bvh, stack, floats3(pool, at(path, RAY)), floats3(pool, at(path, _D)), _INF, time)
        if hit.primitive == NO_PRIMITIVE:
            append(lists, MISSED, path)
            continue
        pool[at(path, _U)] = hit.u
        pool[at(path, _V)] = hit.v
        pool[at(path, HIT)] = hit.t
        store_int(pool, at(path, _PRIMITIVE), hit.primitive)
        if scene.has.instances is not None:
            store_int(pool, at(path, _INSTANCE), hit.instance)
        append(lists, TRIANGLES if hit.primitive < triangles else SPHERES, path)


@subroutine
def see_lights(scene, stack, pool, lists, options):
    """Casts the shadow rays of the vertices that have one, and adds what lights them: how many.

    Paths that go on are the active ones from here on, the others are done.
    """
    out_of_line()
    cast = 0
    clear(lists, ACTIVE)
    for which in range(SCATTERING):
        for k in range(length(lists, which)):
            path = row(lists, which, k)
            if pool[at(path, _WAITS)] != _ZERO:
                cast += 1
                start, end = floats3(pool, at(path, SHADOW)), floats3(pool, at(path, _END))
                time = time_of(scene.has.motion, pool, path)
                share = transmittance(scene, stack, start, end, options.transparent, time)
                if share > _ZERO:
                    brought = vec.scale(floats3(pool, at(path, LAMP)), share)
                    brought = limited(brought, pool[at(path, _SEGMENTS)], options.clamp)
                    for c in range(3):
                        pool[at(path, CARRIED + np.uintp(c))] += brought[c]
            append(lists, ACTIVE if pool[at(path, _GOES_ON)] != _ZERO else DONE, path)
    for k in range(length(lists, PASSED)):
        append(lists, ACTIVE, row(lists, PASSED, k))
    return cast
