"""Starts new paths in free rows of the path pool by generating their camera rays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.simd import store_int
from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel.backends.cpu.lists import ACTIVE, DONE, append, eight_rows, length, pad, row
from renderer.kernel.backends.cpu.rows import (
    Facet,
    Mapped,
    RowHit,
    Sample,
    Shading,
    at,
    column,
    gather,
    scatter,
    second_rows,
)
from renderer.kernel.steps.record_first_hit import no_hit
from renderer.kernel.steps.spawn_camera_ray import spawn_camera_ray
from renderer.kernel.steps.state import PathState, camera_path, no_crossings
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.wide.values import as_wide, zero_like

__all__ = ["NextSample", "start_path", "start_paths"]

_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_NUMBER, _PLACE, _X, _Y = (column(Sample, field) for field in ("number", "place", "x", "y"))


class NextSample(NamedTuple):
    """The next sample of the batch to start: all samples of a pixel come first, then those of the next pixel, row by row."""

    x: Any
    y: Any
    sample: Any


@device
def _number(pool, lists, count, following, width, height, batch):
    """Moves the first `count` free rows of the pool from the list DONE to ACTIVE, one sample for each; returns the next sample.

    DONE holds rows without a path, ACTIVE those whose path has a ray to trace.
    """
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
    return NextSample(x, y, sample)


@template
def start_path(pool, rows, camera, options, motion, medium_stack):
    """Starts the paths of the samples in one row of the pool or in eight. motion, medium_stack: as for `start_paths`."""
    sample = gather(pool, rows, Sample)
    seen = spawn_camera_ray(motion, camera, options, sample.x, sample.y, sample.number)
    none = zero_like(seen.start)
    time = none
    if motion is not None:
        time = seen.time
    one, nothing, no = none + _ONE, as_wide(_NONE, none), none != none
    black = none, none, none
    ray, path = camera_path(seen.o, seen.d)
    scatter(pool, rows, ray)
    scatter(pool, rows, path)
    scatter(pool, second_rows(pool, rows), PathState(black, none, black, none))
    scatter(pool, rows, RowHit(none, none, none, nothing, nothing, none, nothing, none))
    scatter(pool, rows, Sample(seen.stream.pixel, sample.number, sample.place, sample.x, sample.y, time, seen.start, one))
    scatter(pool, rows, Facet(seen.o, none, black, no, no))
    scatter(pool, rows, Shading(black, black, nothing, nothing))
    scatter(pool, rows, no_hit(none))
    scatter(pool, rows, Mapped(black, black, as_wide(NO_OBJECT, black[0])))
    if medium_stack is not None:
        scatter(pool, rows, no_crossings(medium_stack, none))
    elif options.has_depths:
        scatter(pool, rows, no_crossings(_NONE, none))


@subroutine
def start_paths(pool, lists, following, width, height, camera, options, batch, motion, medium_stack):
    """Starts paths in free rows of the pool while samples of the batch remain; returns the next sample to start.

    motion: None for a scene without motion (renderer/arrays/scene_features.py). medium_stack: the media that contain the camera;
    None for a scene without media.
    """
    never_inline()
    left = ((height - following.y) * width - following.x) * batch.count - (following.sample - batch.first)
    count = min(length(lists, DONE), left)
    following = _number(pool, lists, count, following, width, height, batch)
    pad(lists, DONE)
    for k in range(0, count, 8):
        start_path(pool, eight_rows(lists, DONE, k), camera, options, motion, medium_stack)
    return following
