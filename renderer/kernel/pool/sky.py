"""Between stages 2 and 3: first vertices look for the sky in one direction more than the one in which their path goes on.

The sky is mostly found by directions that surfaces choose, and what is noisy is whether they find it: whether something stands
before it, which a ray tells that may end at anything. The two directions are weighed as samples of one strategy against
light sampling (Veach 1997, 9.2).
"""

from __future__ import annotations

import numpy as np

from renderer.jit import out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.light.lights import FAR, environment_seen
from renderer.kernel.pool.lists import CONDUCTOR, DIFFUSE, METALLIC_ROUGHNESS, RARE, WAITING, cut, eight, length, pad, put, row
from renderer.kernel.pool.meet import bring_light
from renderer.kernel.pool.rows import CARRIED, LAMP, SHADOW, at, read, write
from renderer.wide.values import nil

__all__ = ["see_sky"]

_ZERO = np.float32(0.0)
_TWO = np.float32(2.0)
_NUMBER, _WAITS = CARRIED + np.uintp(7), SHADOW + np.uintp(6)


@subroutine
def see_sky(scene, alone, stack, pool, lists, options):
    """Adds what the sky sends to first vertices from where `scatter` has made them look: how many rays it took."""
    out_of_line()
    waiting = np.uintp(0)
    for which in (DIFFUSE, METALLIC_ROUGHNESS, CONDUCTOR, RARE):
        for k in range(length(lists, which)):
            path = row(lists, which, k)
            put(lists, WAITING, waiting, path)
            waiting += np.uintp((pool[at(path, _NUMBER)] == _ZERO) & (pool[at(path, _WAITS)] != _ZERO))
    cut(lists, WAITING, waiting)
    count = np.float32(options.sky_samples)
    for k in range(0, pad(lists, WAITING), 8):
        rows = eight(lists, WAITING, k)
        looked, way, carried = read(pool, rows, LAMP), read(pool, rows, SHADOW), read(pool, rows, CARRIED)
        d, pdf, weight = (looked[0], looked[1], looked[2]), looked[3], (looked[4], looked[5], looked[6])
        emitted, light_pdf = environment_seen(scene, d, pdf > _ZERO)
        share = power_heuristic(count * pdf, light_pdf) / count
        brought = vec.mul((carried[4], carried[5], carried[6]), vec.scale(vec.mul(weight, emitted), share))
        start, none = (way[0], way[1], way[2]), nil(pdf)
        end = vec.add(start, vec.scale(d, FAR))
        write(pool, rows, LAMP, (*brought, carried[3] + _TWO, none, none, none, none))
        write(pool, rows, SHADOW, (*start, *end, way[6], none))
    bring_light(scene, alone, stack, pool, lists, options)
    return np.int64(waiting)
