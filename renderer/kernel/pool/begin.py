"""Stage 0: generates camera rays in free rows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.simd import store_int
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel.camera import camera_ray, moving_ray
from renderer.kernel.integrators.transport import TIME_BLOCK
from renderer.kernel.pool.lists import ACTIVE, DONE, append, eight, length, pad, row
from renderer.kernel.pool.rows import CARRIED, FIRST, FRAME, HIT, MAPPED, NEST, PATHS, PLACE, RAY, SAMPLE, at, read, write
from renderer.kernel.sampling.filter import filter_offset
from renderer.kernel.sampling.sampler import Stream, draw4, draw_film, pixel_key
from renderer.wide.values import as_floats, as_ints, as_wide, nil, to_float

__all__ = ["Next", "begin"]

_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TIME_BLOCK = np.uint32(TIME_BLOCK)
_SECOND = np.uint32(PATHS)
_NUMBER, _PLACE, _X, _Y = (SAMPLE + np.uintp(k) for k in (1, 2, 3, 4))


class Next(NamedTuple):
    """The next sample of the batch to be started; pixel by pixel, row by row."""

    x: Any
    y: Any
    sample: Any


@device
def _number(pool, lists, count, following, width, height, batch):
    """Assigns the next samples to the first `count` rows of the list DONE."""
    x, y, sample = following.x, following.y, following.sample
    for k in range(count):
        path = row(lists, DONE, k)
        store_int(pool, at(path, _X), np.int32(batch.x + x))
        store_int(pool, at(path, _Y), np.int32(batch.y + y))
        store_int(pool, at(path, _NUMBER), np.int32(sample))
        store_int(pool, at(path, _PLACE), np.int32(y * width + x))
        append(lists, ACTIVE, path)
        sample += 1
        if sample == batch.first + batch.count:
            sample = batch.first
            x += 1
            if x == width:
                x = 0
                y += 1
    return Next(x, y, sample)


@subroutine
def begin(pool, lists, following, width, height, camera, options, batch, motion, nest):
    """Starts paths in free rows while samples remain; returns the next sample to start.

    motion: None for a scene without motion (renderer/arrays/scene_features.py). nest: the media that contain the camera, None
    for a scene without media.
    """
    out_of_line()
    left = ((height - following.y) * width - following.x) * batch.count - (following.sample - batch.first)
    count = min(length(lists, DONE), left)
    following = _number(pool, lists, count, following, width, height, batch)
    pad(lists, DONE)
    for k in range(0, count, 8):
        rows = eight(lists, DONE, k)
        told = read(pool, rows, SAMPLE)
        sample, x, y = as_ints(told[1]), as_ints(told[3]), as_ints(told[4])
        key = pixel_key(x, y)
        u = draw_film(Stream(options.sampler, options.seed, key, sample))
        film_x = to_float(x) + _HALF + filter_offset(options.filter, u[0])
        film_y = to_float(y) + _HALF + filter_offset(options.filter, u[1])
        none = nil(film_x)
        if motion is not None:
            time = draw4(Stream(options.sampler, options.seed, key, sample), _TIME_BLOCK)[0]
            o, d, start = moving_ray(camera, film_x, film_y, (u[2], u[3]), time)
        else:
            time = none
            o, d, start = camera_ray(camera, film_x, film_y, (u[2], u[3]))
        one = none + _ONE
        nothing = none, none, none, none, none, none, none, none
        write(pool, rows, RAY, (*o, *d, none, one))
        write(pool, rows, CARRIED, (none, none, none, none, one, one, one, none))
        write(pool, rows + _SECOND, CARRIED, nothing)
        write(pool, rows, HIT, nothing)
        write(pool, rows, SAMPLE, (as_floats(key), told[1], told[2], told[3], told[4], time, start, one))
        write(pool, rows, PLACE, (*o, none, none, none, none, none))
        write(pool, rows, FRAME, nothing)
        write(pool, rows, FIRST, nothing)
        write(pool, rows, FIRST + np.uintp(8), nothing)
        write(pool, rows, MAPPED, nothing)
        if nest is not None:
            write(pool, rows, NEST, (as_floats(as_wide(nest, none)), none, none, none, none, none, none, none))
        elif options.has_depths:
            write(pool, rows, NEST, nothing)
    return following
