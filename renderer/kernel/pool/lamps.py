"""Stage 3: for each vertex that light sampling can serve, a point of a light."""

from __future__ import annotations

import numpy as np

from renderer.jit import out_of_line, subroutine
from renderer.kernel.light.lights import sample_light
from renderer.kernel.pool.lists import LIT, eight, pad
from renderer.kernel.pool.rows import CARRIED, FRAME, LAMP, MAPPED, PLACE, SHADOW, few, times_of, write
from renderer.kernel.pool.scatter import stream_of
from renderer.kernel.sampling.sampler import draw4
from renderer.wide.values import nil, to_int, where

__all__ = ["choose_lamps"]

_ONE = np.float32(1.0)
_LIGHT_BLOCK = np.uint32(1)
_TWO = np.uint32(2)
_NUMBER = CARRIED + np.uintp(7)


@subroutine
def choose_lamps(scene, pool, lists, options):
    """Samples a light for each vertex that is to be lit."""
    out_of_line()
    for k in range(0, pad(lists, LIT), 8):
        rows = eight(lists, LIT, k)
        number = to_int(few(pool, rows, _NUMBER, 1)[0])
        u = draw4(stream_of(pool, rows, options), number * _TWO + _LIGHT_BLOCK)
        point, n = few(pool, rows, PLACE, 3), few(pool, rows, FRAME, 3)
        if scene.has.textures is not None:
            n = few(pool, rows, MAPPED + np.uintp(3), 3)
        light = sample_light(scene, point, n, u[2], (u[0], u[1]), times_of(scene.has.motion, pool, rows))
        none = nil(u[0])
        alone = where(light.alone, nil(none) + _ONE, none)
        write(pool, rows, LAMP, (*light.direction, light.pdf, *light.radiance, alone))
        write(pool, rows, SHADOW, (none, none, none, *light.end, none, none))
