"""The record of one path, for inspection of a pixel: a table with a row for each surface or medium event on the path.

Integrators fill the record if it has rows. Frames are rendered without rows by the same machine code, so the record has the same
bits as the film.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device, never_inline, subroutine

__all__ = [
    "COLUMNS",
    "DIRECT",
    "EMITTED",
    "IN_MEDIUM",
    "MISSED",
    "PASSED",
    "SECOND_BRANCH",
    "SURFACE",
    "UNSEEN",
    "record_light",
    "record_medium",
    "record_miss",
    "record_second_branch",
    "record_surface",
]

# Kinds of rows. UNSEEN: none written.
UNSEEN, SURFACE, PASSED, MISSED, IN_MEDIUM = range(5)

# Columns, float64.
KIND, OBJECT, MATERIAL, DISTANCE, PDF = range(5)
POINT, NORMAL, DIRECTION, THROUGHPUT, BEFORE, EMITTED, DIRECT, SECOND_BRANCH = range(5, 29, 3)
# Written for paths of the pool only, in rows where RECORDED is set. EMISSION_WEIGHT: MIS weight of the vertex's own emission, 0
# if it has none. Of the light sample: LIGHT_AT, its point; BROUGHT, its radiance if visible; LIGHT_PDF, per steradian, 0 if there
# is none; LIGHT_WEIGHT, its MIS weight. SURVIVAL: probability that the path continues; negative if it ended, 0 if no throughput
# was left. TIME: shutter time. LIMIT: the bounce limit that was reached (`limit_of` in depths.py), 0 for none.
LIGHT_AT, BROUGHT = 29, 32
EMISSION_WEIGHT, LIGHT_PDF, LIGHT_WEIGHT, SURVIVAL, TIME, RECORDED, LIMIT = range(35, 42)
COLUMNS = 42
ARRIVED, SCATTERED = 1.0, 2.0  # values of RECORDED: whether the vertex scattered

_FAR = np.float32(np.inf)


@subroutine
def _record(log, row, kind, distance, point, normal, ray, path):
    never_inline()
    log[row, KIND] = kind
    log[row, DISTANCE] = distance
    log[row, PDF] = ray.pdf
    vectors = ((POINT, point), (NORMAL, normal), (DIRECTION, ray.d), (THROUGHPUT, path.throughput), (BEFORE, path.radiance))
    for i, v in vectors:
        log[row, i] = v[0]
        log[row, i + 1] = v[1]
        log[row, i + 2] = v[2]
    for i in range(3):  # what follows may not be written
        log[row, EMITTED + i] = path.radiance[i]
        log[row, DIRECT + i] = path.radiance[i]


@device
def record_surface(log, row, surface, point, through, distance, ray, path):
    """Records the surface hit by the path's ray, the throughput on arrival, and whether the path passed through the surface.

    log: the record; nothing is recorded beyond its last row. row: index of the row, an integer, or a float without fraction.
    """
    entry = np.int64(row)
    if entry < len(log):
        log[entry, OBJECT] = 1 + surface.object
        log[entry, MATERIAL] = 1 + surface.material
        _record(log, entry, PASSED if through else SURFACE, distance, point, surface.shading, ray, path)


@device
def record_medium(log, row, point, distance, ray, path):
    """Records a scattering point in a medium at `distance` along the ray, and the throughput on arrival.

    log, row: as for `record_surface`.
    """
    entry = np.int64(row)
    if entry < len(log):
        log[entry, OBJECT] = 0
        log[entry, MATERIAL] = 0
        _record(log, entry, np.int64(IN_MEDIUM), distance, point, ray.d, ray, path)


@device
def record_miss(log, row, ray, path):
    """Records that the path's ray missed all surfaces and reached the environment. log, row: as for `record_surface`."""
    entry = np.int64(row)
    if entry < len(log):
        log[entry, OBJECT] = 0
        log[entry, MATERIAL] = 0
        _record(log, entry, np.int64(MISSED), _FAR, ray.o, ray.d, ray, path)


@subroutine
def _record_light(log, row, column, radiance):
    never_inline()
    for i in range(3):
        for j in range(column, DIRECT + 3, 3):
            log[row, j + i] = radiance[i]


@device
def record_light(log, row, column, radiance):
    """Records the accumulated radiance in three columns of the record's row.

    column: EMITTED for the radiance including the vertex's emission, DIRECT for that including its direct light. log, row: as for
    `record_surface`.
    """
    entry = np.int64(row)
    if entry < len(log):
        _record_light(log, entry, np.int64(column), radiance)


@subroutine
def record_second_branch(log, radiance):
    """Records the radiance of the second branch, which splits from the recorded path at its first vertex (steps/splitting.py)."""
    never_inline()
    for row in range(len(log)):
        if log[row, KIND] == SURFACE or log[row, KIND] == IN_MEDIUM:
            for i in range(3):
                log[row, SECOND_BRANCH + i] = radiance[i]
            break
