"""Pilot paths, from which a guide is trained: follows paths from the camera, and records the light that arrives at each vertex.

A record describes a vertex on a surface that is not specular, and one segment of the path from there on. Light that light
sampling finds at the vertex itself is left out of what arrives, since no direction has to be found for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device, entry, local_floats, never_inline, subroutine
from renderer.kernel.backends.scalar.first_hit import FIRST_HIT_SLOTS
from renderer.kernel.backends.scalar.light import has_lights
from renderer.kernel.backends.scalar.picture import trace_with
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.path_trace import DIRECT, DIRECTION, KIND, NORMAL, PASSED, PDF, POINT, SURFACE, THROUGHPUT, UNSEEN
from renderer.kernel.sampling.sampler import hash4
from renderer.kernel.steps.spawn_camera_ray import spawn_camera_ray
from renderer.luminance import REC_709
from renderer.reference import by_reference

__all__ = ["MOST_ROWS", "RECORD_COLUMNS", "Pilot", "follow_pilot_paths", "record_photon"]

# Columns of a record, float32: the vertex, its normal on the viewer's side, and the direction to the next vertex; the light that
# the next vertex sends back by its own emission and light samples, or if the record is not linked, all of it; the cosine over the
# density of the direction, 0 if the path ended; the light from other directions than its light samples' that the vertex itself
# sends back; and 1 if the record is linked: the next record is that of the next vertex. Light is luminance.
RECORD_POINT, RECORD_NORMAL, RECORD_DIRECTION, RECORD_NEAR, RECORD_SCALE, RECORD_INDIRECT, RECORD_LINKED = 0, 3, 6, 9, 10, 11, 12
RECORD_COLUMNS = 13
MOST_ROWS = 64  # of a path's log: later vertices are not recorded
_RED, _GREEN, _BLUE = REC_709


class Pilot(NamedTuple):
    """The pilot paths of one call: `count` paths from number `first` on, over an image of width x height pixels."""

    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    width: int
    height: int


@device
def _luminance(log, row, column):
    return _RED * log[row, column] + _GREEN * log[row, column + 1] + _BLUE * log[row, column + 2]


@device
def _dot(log, row, column, normal_row):
    """Returns the dot product of a vector of one row with the normal of another."""
    total = 0.0
    for i in range(3):
        total += log[row, column + i] * log[normal_row, NORMAL + i]
    return total


@device
def _is_rough(log, rows, k):
    """Returns True if row k of a path's log is a vertex on a surface that is not specular, or one where the path ended."""
    return log[k, KIND] == SURFACE and (k + 1 >= rows or log[k + 1, PDF] > 0.0)


@device
def _store(records, count, column, log, row, first, sign):
    for i in range(3):
        records[count, column + i] = sign * log[row, first + i]


@subroutine
def _record_vertices(log, records, count):
    """Appends the records of a path's vertices to `records`, clears the log, and returns the number of records."""
    never_inline()
    rows = 0
    while rows < len(log) and log[rows, KIND] != UNSEEN:
        rows += 1
    found = _luminance(log, rows - 1, DIRECT) if rows > 0 else 0.0
    for k in range(rows):
        carried = _luminance(log, k, THROUGHPUT)
        if not _is_rough(log, rows, k) or not carried > 0.0 or count >= len(records):
            continue
        own = _luminance(log, k, DIRECT)
        facing = _dot(log, k, DIRECTION, k)
        _store(records, count, RECORD_POINT, log, k, POINT, 1.0)
        _store(records, count, RECORD_NORMAL, log, k, NORMAL, -1.0 if facing > 0.0 else 1.0)
        records[count, RECORD_INDIRECT] = max(found - own, 0.0) / carried
        after = k + 1
        while after < rows and log[after, KIND] == PASSED:
            after += 1
        near, scale, is_linked, row = 0.0, 0.0, False, k
        if after < rows and log[k + 1, PDF] > 0.0:
            carried, row = _luminance(log, after, THROUGHPUT), k + 1
            if carried > 0.0:
                is_linked = _is_rough(log, rows, after) and count + 1 < len(records)
                near = max((_luminance(log, after, DIRECT) if is_linked else found) - own, 0.0) / carried
                scale = abs(_dot(log, k + 1, DIRECTION, k)) / log[k + 1, PDF]
        _store(records, count, RECORD_DIRECTION, log, row, DIRECTION, 1.0)
        records[count, RECORD_NEAR] = near
        records[count, RECORD_SCALE] = scale
        records[count, RECORD_LINKED] = 1.0 if is_linked else 0.0
        count += 1
    for k in range(rows):
        log[k, KIND] = UNSEEN
    return count


@subroutine
def record_photon(log, records, count):
    """Appends records of the flux that a photon brings to its vertices, but the first; otherwise as `_record_vertices`.

    In these records the direction is that from which the photon comes, and RECORD_NEAR is the flux.
    """
    never_inline()
    rows = 0
    while rows < len(log) and log[rows, KIND] != UNSEEN:
        rows += 1
    scattered = False
    for k in range(rows):
        flux = _luminance(log, k, THROUGHPUT)
        if scattered and _is_rough(log, rows, k) and flux > 0.0 and count < len(records):
            facing = _dot(log, k, DIRECTION, k)
            _store(records, count, RECORD_POINT, log, k, POINT, 1.0)
            _store(records, count, RECORD_NORMAL, log, k, NORMAL, -1.0 if facing > 0.0 else 1.0)
            _store(records, count, RECORD_DIRECTION, log, k, DIRECTION, -1.0)
            records[count, RECORD_NEAR] = flux
            count += 1
        scattered = scattered or log[k, KIND] != PASSED
    for k in range(rows):
        log[k, KIND] = UNSEEN
    return count


@subroutine
def _follow(scene, stack, camera, options, pilot, log, records):
    never_inline()
    first_hit = local_floats(FIRST_HIT_SLOTS)
    lit = has_lights(scene)
    medium_stack = media_of_camera(scene, stack, camera, pilot.count)
    count = 0
    for number in range(pilot.first, pilot.first + pilot.count):
        at = hash4(options.seed, np.uint32(number), np.uint32(0), np.uint32(0))
        x = np.int64(np.uint64(at[0]) * np.uint64(pilot.width) >> np.uint64(32))
        y = np.int64(np.uint64(at[1]) * np.uint64(pilot.height) >> np.uint64(32))
        ray = spawn_camera_ray(scene.has.motion, camera, options, x, y, np.uint32(number))
        trace_with(scene, stack, ray, medium_stack, options, log, first_hit, lit)
        count = _record_vertices(log, records, count)
    return count


@entry
def follow_pilot_paths(scene, stack, camera, options, pilot, log, records):
    """Follows pilot paths and writes their records; returns the number of records.

    scene: with a path guide, which may be empty. options: without splitting. log: (MOST_ROWS, COLUMNS) float64, zeros. records:
    (n, RECORD_COLUMNS) float32; further records are dropped.
    """
    return _follow(by_reference(scene), stack, camera, options, pilot, log, records)
