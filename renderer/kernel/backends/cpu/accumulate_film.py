"""Adds the radiance of terminated paths to the film's fixed-point sums per pixel.

At the end, moves them to its planes.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load, load_int
from renderer.film import (
    ALBEDO,
    CHANNELS,
    COLOR,
    COLOR_HALF,
    DEPTH,
    MATERIAL,
    NORMAL,
    OBJECT,
    POSITION,
    SAMPLES,
    SAMPLES_HALF,
)
from renderer.jit import never_inline, subroutine
from renderer.kernel.backends.cpu.lists import DONE, cut, length, put, row
from renderer.kernel.backends.cpu.rows import PATHS, Sample, at, column
from renderer.kernel.fixed_point import add_fixed8, in_half, of_sample
from renderer.kernel.steps.state import FirstHit, PathState
from renderer.wide.values import any_of, not_

__all__ = ["SUMS", "accumulate_film", "unfold"]

_ZERO = np.float32(0.0)
_INF = np.float32(np.inf)
_ONE = np.float32(1.0)
SUMS = 24  # numbers kept of a pixel: radiance 3, samples; of the half 3, samples; FirstHit
_SUMS, _PATHS, _1, _8, _16, _17, _18 = (np.uintp(k) for k in (SUMS, PATHS, 1, 8, 16, 17, 18))
_OBJECT, _MATERIAL = 15, 19
_COLUMNS = {SAMPLES: 3, SAMPLES_HALF: 7, DEPTH: 11, OBJECT: _OBJECT, MATERIAL: _MATERIAL}
for _plane, _first in ((COLOR, 0), (COLOR_HALF, 4), (ALBEDO, 8), (NORMAL, 12), (POSITION, 16)):
    _COLUMNS.update({_plane.start + _k: _first + _k for _k in range(3)})
_COLUMN_OF = np.array([_COLUMNS[channel] for channel in range(CHANNELS)], np.int64)
_RADIANCE, _FIRST, _POINT = column(PathState, "radiance"), column(FirstHit, "albedo"), column(FirstHit, "point")
_DEPTH_OF, _OBJECT_OF, _MATERIAL_OF = (column(FirstHit, field) for field in ("distance", "object", "material"))
_SAMPLE, _PIXEL, _BRANCHES = (column(Sample, field) for field in ("number", "place", "branches"))
assert (_FIRST, _POINT) == (_FIRST // 8 * 8, _FIRST + 8), "the film's groups of eight numbers are those of FirstHit"


@subroutine
def accumulate_film(pool, lists, film, scale, width, batch, bad, bad_count):
    """Adds the samples whose branches have all terminated to their pixels' sums, and leaves the free rows on the list DONE.

    Returns the number of bad samples (NaN or infinite), which are listed in `bad` and not added.
    """
    never_inline()
    ox, oy, oz = batch.origin
    is_far = (ox | oy | oz) != 0
    one = _ONE / scale  # becomes 1 in fixed point
    free = np.uintp(0)
    for k in range(length(lists, DONE)):
        path = row(lists, DONE, k) % _PATHS
        pool[at(path, _BRANCHES)] -= _ONE
        if pool[at(path, _BRANCHES)] > _ZERO:
            continue
        put(lists, DONE, free, path)
        free += _1
        sample, place = load_int(pool, at(path, _SAMPLE)), load_int(pool, at(path, _PIXEL))
        found = load(pool, at(path, _RADIANCE)) + load(pool, at(path + _PATHS, _RADIANCE))
        light = of_sample(found, one, in_half(sample))
        first, beyond = load(pool, at(path, _FIRST)), load(pool, at(path, _POINT))  # numbers, as floats, are all but 0
        if any_of(not_((abs(light) < _INF) & (abs(first) < _INF) & (abs(beyond) < _INF))):
            if bad_count < len(bad):
                bad[bad_count, 0] = batch.x + place % width
                bad[bad_count, 1] = batch.y + place // width
                bad[bad_count, 2] = sample
            bad_count += 1
            continue
        base = np.uintp(place) * _SUMS
        add_fixed8(film, base, light, scale)
        add_fixed8(film, base + _8, first, scale)
        add_fixed8(film, base + _16, beyond, scale)
        if is_far and pool[at(path, _DEPTH_OF)] > _ZERO:
            film[base + _16] += ox
            film[base + _17] += oy
            film[base + _18] += oz
        if sample == 0:  # ids cannot be averaged, so the first sample decides
            film[base + np.uintp(_OBJECT)] += load_int(pool, at(path, _OBJECT_OF))
            film[base + np.uintp(_MATERIAL)] += load_int(pool, at(path, _MATERIAL_OF))
    cut(lists, DONE, free)
    return bad_count


@subroutine
def unfold(film, sums):
    """Moves the pixels' sums to the planes, (CHANNELS, h, w), and resets them to 0.

    Works row by row, one plane at a time, since one pixel's entries in all planes map to the same cache sets.
    """
    never_inline()
    height, width = sums.shape[1], sums.shape[2]
    for y in range(height):
        for channel in range(CHANNELS):
            at_pixel = np.uintp(y * width) * _SUMS + np.uintp(_COLUMN_OF[channel])
            for x in range(width):
                sums[channel, y, x] += film[at_pixel]
                film[at_pixel] = 0
                at_pixel += _SUMS
