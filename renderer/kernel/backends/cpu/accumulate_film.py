"""Adds the radiance of terminated paths to fixed-point sums per pixel, and at the end moves these to the film's planes."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load, load_int
from renderer.film import ALPHA_PLANES, CHANNELS, COLOR, COLOR_HALF, SAMPLES, SAMPLES_HALF
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import DONE, length, put, row, truncate
from renderer.kernel.backends.cpu.rows import FIRST_GROUP, PATHS, Sample, at, column
from renderer.kernel.fixed_point import add_fixed8, fixed, in_half, sample_contribution
from renderer.kernel.light_groups import add_to_plane, forget_groups
from renderer.kernel.light_paths import add_sample_by_light
from renderer.kernel.steps.record_first_hit import DEEP, IDS, MEANS, FirstHit
from renderer.kernel.steps.state import PathState
from renderer.wide.fields import columns_of, width_of
from renderer.wide.values import any_of, not_

__all__ = ["SUMS", "accumulate_film", "flush_film"]

_ZERO = np.float32(0.0)
_INF = np.float32(np.inf)
_ONE = np.float32(1.0)
_GROUPS = width_of(FirstHit) // 8
SUMS = 8 + 8 * _GROUPS  # numbers per pixel: radiance 3, samples; the same of the half buffer; FirstHit
_SUMS, _PATHS, _1, _2, _3, _8 = (np.uintp(k) for k in (SUMS, PATHS, 1, 2, 3, 8))
_COLUMNS = {plane: 8 + first_hit_column for first_hit_column, plane in (*MEANS.tolist(), *IDS.tolist())}
_COLUMNS.update({SAMPLES: 3, SAMPLES_HALF: 7})
for _first, _planes in ((0, COLOR), (4, COLOR_HALF)):
    _COLUMNS.update({plane: _first + k for k, plane in enumerate(range(_planes.start, _planes.stop))})
_COLUMN_OF = np.array([_COLUMNS[channel] for channel in range(CHANNELS)], np.int64)
_COUNT, _UNCOVERED = np.uintp(_COLUMNS[SAMPLES]), np.uintp(8 + columns_of(FirstHit, "uncovered")[0])
_CAUGHT, _SHADOWED = column(FirstHit, "caught"), column(FirstHit, "shadowed")
_POINT = np.uintp(8 + columns_of(FirstHit, "point")[0])
_RADIANCE, _FIRST, _DISTANCE = column(PathState, "radiance"), column(FirstHit, "albedo"), column(FirstHit, "distance")
_SAMPLE, _PIXEL, _BRANCHES = (column(Sample, field) for field in ("number", "place", "branches"))
assert columns_of(FirstHit, "albedo")[0] == 0, "FirstHit begins with its albedo"


@subroutine
def accumulate_film(pool, lists, film, scale, width, batch, bad, bad_count, by_group, records):
    """Adds the radiance of samples whose branches have all terminated to their pixels' sums, and frees their rows of the pool.

    The list DONE contains the free rows on return. Returns the number of bad samples (NaN or infinite), which are listed in `bad`
    and not added. by_group: None, or the numbers of light groups, of light paths and of a branch's rows for them, and the index
    in `film` of their sums, pixel by pixel. records: see Output (renderer/kernel/accumulate.py).
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
        light = sample_contribution(found, one, in_half(sample))
        first = at(path, _FIRST)
        is_finite = abs(light) < _INF
        for group in range(_GROUPS):
            is_finite = is_finite & (abs(load(pool, first + np.uintp(group) * _8)) < _INF)
        if any_of(not_(is_finite)):
            if bad_count < len(bad):
                bad[bad_count, 0] = batch.x + place % width
                bad[bad_count, 1] = batch.y + place // width
                bad[bad_count, 2] = sample
            bad_count += 1
            if by_group is not None:
                _forget(pool, path, by_group[2])
            continue
        is_black = pool[at(path, _CAUGHT)] > _ZERO and pool[at(path, _SHADOWED)] < _ZERO
        if is_black:  # a shadow
            pool[at(path, _SHADOWED)] = vec.luminance(_radiance(pool, path))
            light = sample_contribution(found - found, one, in_half(sample))
            if by_group is not None:
                _forget(pool, path, by_group[2])
        elif by_group is not None:
            _add_groups(pool, path, film, place, scale, by_group)
        base = np.uintp(place) * _SUMS
        add_fixed8(film, base, light, scale)
        for group in range(_GROUPS):  # an id, read as a float, is too small to count
            offset = np.uintp(group) * _8
            add_fixed8(film, base + _8 + offset, load(pool, first + offset), scale)
        if is_far and pool[at(path, _DISTANCE)] > _ZERO:
            film[base + _POINT] += ox
            film[base + _POINT + _1] += oy
            film[base + _POINT + _2] += oz
        if len(records) > 0:
            _record(records, place * batch.count + sample - batch.first, pool, path, is_black)
        if sample == 0:
            for k in range(len(IDS)):
                film[base + _8 + IDS[k, 0]] += load_int(pool, first + IDS[k, 0])
    truncate(lists, DONE, free)
    return bad_count


@device
def _group_row(path, rows):
    return np.uintp(FIRST_GROUP) + path * np.uintp(rows)


@device
def _forget(pool, path, rows):
    """Resets the light by group of both branches of a path to 0, for the next path in its row. rows: of a branch."""
    forget_groups(pool, _group_row(path, rows), np.uintp(rows))
    forget_groups(pool, _group_row(path + _PATHS, rows), np.uintp(rows))


@device
def _radiance(pool, path):
    """Returns the radiance of both branches of a path."""
    first, second = at(path, _RADIANCE), at(path + _PATHS, _RADIANCE)
    return pool[first] + pool[second], pool[first + _1] + pool[second + _1], pool[first + _2] + pool[second + _2]


@subroutine
def _record(records, number, pool, path, is_black):
    """Stores what is recorded of a path in row `number` of `records`. is_black: whether its radiance is a catcher's."""
    never_inline()
    first = at(path, _FIRST)
    for k in range(len(IDS)):
        records[number, k] = load_int(pool, first + IDS[k, 0])
    if records.shape[1] > len(IDS):
        red, green, blue = _radiance(pool, path)
        if is_black:
            red, green, blue = _ZERO, _ZERO, _ZERO
        records[number, len(IDS)] = np.float32(red).view(np.uint32)
        records[number, len(IDS) + 1] = np.float32(green).view(np.uint32)
        records[number, len(IDS) + 2] = np.float32(blue).view(np.uint32)
        for k in range(len(DEEP)):
            records[number, len(IDS) + 3 + k] = load_int(pool, first + DEEP[k])


@device
def _add_groups(pool, path, film, place, scale, by_group):
    """Adds a path's light by group to its pixel's sums, and resets it to 0 for the next path in its row."""
    groups, paths, rows, begin = by_group
    first, second, radiance = _group_row(path, rows), _group_row(path + _PATHS, rows), _radiance(pool, path)
    base = begin + np.uintp(place) * _3 * (np.uintp(groups) + np.uintp(paths))
    add_sample_by_light(film, base, _1, pool, (first, second), (groups, paths), radiance, scale, add_to_plane)
    _forget(pool, path, rows)


@device
def _flush_alpha(film, sums, one):
    """Adds the pixels' alpha to the film's last planes. one: 1 in fixed point; a sample covers that, less what is uncovered."""
    first, height, width = sums.shape[0] - ALPHA_PLANES, sums.shape[1], sums.shape[2]
    for y in range(height):
        base = np.uintp(y * width) * _SUMS
        for x in range(width):
            sums[first, y, x] += film[base + _COUNT] * one - film[base + _UNCOVERED]
            film[base + _UNCOVERED] = 0
            for k in range(1, ALPHA_PLANES):
                sums[first + k, y, x] += film[base + _UNCOVERED + np.uintp(k)]
                film[base + _UNCOVERED + np.uintp(k)] = 0
            base += _SUMS


@subroutine
def flush_film(film, sums, scale, is_transparent):
    """Moves the pixels' sums to the film's planes, (planes, h, w), and resets them to 0.

    scale: 2**film_exponent. is_transparent: whether the last planes are those of the alpha.

    Works row by row, one plane at a time, since one pixel's entries in all planes map to the same cache sets.
    """
    never_inline()
    height, width = sums.shape[1], sums.shape[2]
    further = sums.shape[0] - CHANNELS
    if is_transparent:
        _flush_alpha(film, sums, fixed(_ONE, scale))
        further -= ALPHA_PLANES
    for y in range(height):
        for channel in range(CHANNELS):
            at_pixel = np.uintp(y * width) * _SUMS + np.uintp(_COLUMN_OF[channel])
            for x in range(width):
                sums[channel, y, x] += film[at_pixel]
                film[at_pixel] = 0
                at_pixel += _SUMS
    begin = np.uintp(height * width) * _SUMS
    for k in range(further):  # planes by light group
        for y in range(height):
            at_pixel = begin + np.uintp(y * width) * np.uintp(further) + np.uintp(k)
            for x in range(width):
                sums[CHANNELS + k, y, x] += film[at_pixel]
                film[at_pixel] = 0
                at_pixel += np.uintp(further)
