"""Learns a guide of portals (renderer/arrays/guide.py) from records of pilot paths: where much light crosses a small space.

A door that is ajar, a small window, and the patch of floor that a lamp lights through them are such places. Segments of paths
are drawn in proportion to their part of the light that arrives in their cube, and counted in voxels of two sizes. The voxel
that saves most becomes a portal: a sphere about it, moved to where its segments come nearest to each other. They do not count for
the next. The second moment that a portal saves is in proportion to its squared count over its squared size; the exponent of the
size is 1.5 here, since few large portals cost less than many small ones.

All sums are of integers, and segments are drawn without random numbers, so a guide is a function of the records.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.guide import (
    COUNT,
    MOST_PORTALS,
    OTHER_RADIANCE,
    PORTAL_COLUMNS,
    PORTAL_RADIUS,
    RADIANCE_COLUMNS,
    Guide,
    portal_guide,
)
from renderer.guiding.histograms import Records, arriving, cells_of, cubes_of, frame_of, integers, sums
from renderer.guiding.voxels import Voxels
from renderer.kernel.guiding.pilot import RECORD_DIRECTION, RECORD_LINKED, RECORD_NEAR, RECORD_NORMAL, RECORD_POINT, RECORD_SCALE
from renderer.kernel.steps.portals import MIN_DISTANCE2, MOST_CHANCE, OTHER_WEIGHT

__all__ = ["Segments", "learn_portals", "lit_part", "moment_left", "segments_of"]

F64 = npt.NDArray[np.float64]
Floats = npt.NDArray[Any]  # float32 or float64
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_CUBES = 8  # along the longest side of the region of the records
_VOXELS = (48, 24)  # along that of the region with a margin
_MARGIN = 0.1  # on each side, relative to the longest side
_RADIUS = 0.75  # of a portal, in sizes of its voxel
_DRAWN = 1 << 14  # segments that are counted
_LEAST_PART = 0.002  # of the drawn segments, for a portal
_LEVELS = 4  # cubes of 1, 2, 4, 8 times the size
_PRIOR = 32.0  # steradians of directions with the radiance of the cube of twice the size, added to those of a cube's records
_LEAST_COSINE = 1e-3
_MOST_SHIFT = 3.0  # of a portal that is moved, in its radii
_LEAST_SHRINK = 0.25  # of its radius
_KEPT = 0.99  # of its segments, which the shrunk portal contains
_FAR = 1e30
_LEAST = 1e-30
_BLOCKS = 8  # of segments, which are those of whole paths but at the blocks' ends
_STRIDE = 16  # a grid's frame is measured from every 16th record


class Segments(NamedTuple):
    """The segments of pilot paths that leave a surface, (n,) or (n, 3) each; of records, in float32."""

    point: Floats
    normal: Floats
    direction: Floats
    cosine: Floats  # between the normal and the direction
    solid: Floats  # reciprocal of the direction's pdf, steradians
    length: Floats  # _FAR if it is not known
    radiance: Floats  # that arrives along the segment


def lit_part(records: Records) -> float:
    """Returns the fraction of segments at whose end light is found, by light samples or as emission; 0 without segments."""
    near = records[records[:, RECORD_SCALE] > 0, RECORD_NEAR]
    return float(np.count_nonzero(near > 0)) / max(len(near), 1)


def segments_of(records: Records) -> Segments:
    """Returns the segments of records of whole paths."""
    column = np.ascontiguousarray(records.T)  # one column after the other: a tenth of a second less for a million records
    points = column[RECORD_POINT : RECORD_POINT + 3].T
    cell = cells_of(column.T, frame_of(points[::_STRIDE]))
    light = arriving(column.T, cell, int(cell.max()) + 1)
    normal, direction = (column[k : k + 3].T for k in (RECORD_NORMAL, RECORD_DIRECTION))
    cosine, scale = _dot(normal, direction), column[RECORD_SCALE]
    step = np.diff(points, axis=0)
    length = np.append(np.sqrt(_dot(step, step)), np.float32(_FAR))
    length[column[RECORD_LINKED] == 0] = _FAR
    used = np.flatnonzero((scale > 0) & (cosine > _LEAST_COSINE))
    point, normal, direction = (column[k : k + 3].take(used, axis=1).T for k in (RECORD_POINT, RECORD_NORMAL, RECORD_DIRECTION))
    cosine, scale = cosine[used], scale[used]
    radiance = light[used].astype(np.float32) / scale
    return Segments(point, normal, direction, cosine, scale / cosine, length[used], radiance)


def learn_portals(segments: Segments) -> Guide | None:
    """Returns a guide of the portals of the segments' region; None if it has none."""
    if not (segments.radiance > 0).any():
        return None
    frame = frame_of(segments.point[::_STRIDE].astype(np.float32), _CUBES)
    cube, cubes = _cube_of(segments, frame)
    portals = _find(segments, _parts(segments, cube, cubes))
    if not portals:
        return None
    table = np.array(portals, np.float32)
    solid, unit = integers(segments.solid)
    light, its_unit = integers(segments.radiance * segments.solid)
    levels = [_parents(frame, level) for level in range(_LEVELS)]
    radiance, is_other = np.zeros((cubes, RADIANCE_COLUMNS)), np.ones(len(cube), bool)
    for k, portal in enumerate(table):
        through = np.flatnonzero(_crosses(portal, segments))
        first = through[is_other[through]]
        brought, seen = [sums(cube[first], light[first], cubes)], [sums(cube[through], solid[through], cubes)]
        for parent, count in levels[:-1]:
            brought.append(sums(parent, brought[-1], count))
            seen.append(sums(parent, seen[-1], count))
        its_radiance = np.zeros(1)
        for (parent, _), its_light, its_solid in zip(reversed(levels), reversed(brought), reversed(seen), strict=True):
            its_radiance = (its_light * its_unit + _PRIOR * its_radiance[parent]) / (its_solid * unit + _PRIOR)
        radiance[:, k] = its_radiance
        is_other[first] = False
    beside = sums(cube[is_other], solid[is_other], cubes) * unit
    other = sums(cube[is_other], light[is_other], cubes) * its_unit / np.maximum(beside, unit)
    radiance[:, : len(table)] = np.maximum(radiance[:, : len(table)] - other[:, None], 0)
    radiance[:, OTHER_RADIANCE] = other
    return portal_guide(frame, table, radiance.astype(np.float32))


def moment_left(guide: Guide, segments: Segments) -> tuple[float, float]:
    """Returns (the fraction that a guide leaves of the second moments at diffuse vertices, the fraction's standard error).

    The moments are relative to the light of each vertex's cube. The error is that of the jackknife, over blocks of segments.
    segments: not those from which the guide was learned.
    """
    cube, cubes = _cube_of(segments, guide.frame)
    radiance, lambertian = guide.radiance[cube], segments.cosine / math.pi
    total, found = np.zeros(len(cube), np.float32), np.zeros(len(cube), np.float32)
    for k, portal in enumerate(guide.portal):
        to_center = portal[:3] - segments.point
        square, radius2 = _dot(to_center, to_center), portal[PORTAL_RADIUS] * portal[PORTAL_RADIUS]
        outside = square > MIN_DISTANCE2 * radius2
        square = np.where(outside, square, MIN_DISTANCE2 * radius2)
        cosine = (_dot(segments.normal, to_center) + 0.5 * portal[PORTAL_RADIUS]) / np.sqrt(square)
        strength = np.where(outside & (cosine > 0), radiance[:, k] * np.minimum(cosine, 1), 0)
        total += strength * (radius2 / square / (1 + np.sqrt(1 - radius2 / square)))
        along = _dot(to_center, segments.direction)
        found += np.where((along > 0) & (_dot(to_center, to_center) - along * along <= radius2), strength, 0)
    share = np.minimum(total / np.maximum(total + float(OTHER_WEIGHT) * radiance[:, OTHER_RADIANCE], _LEAST), MOST_CHANCE)
    mixture = (1 - share) * lambertian + share * found / (2 * math.pi * np.maximum(total, _LEAST))
    part = _parts(segments, cube, cubes)
    if not part.any():
        return 1.0, 0.0
    moments = np.stack((part * part / (segments.solid * lambertian), part * part / (segments.solid * mixture)))
    units, unit = integers(moments[0])
    after = np.ceil(np.minimum(moments[1] / unit, 2.0**21)).astype(np.int64)
    block = np.arange(len(units)) * _BLOCKS // len(units)
    kept, whole = sums(block, after, _BLOCKS), sums(block, units, _BLOCKS)
    without = [int(kept.sum() - a) / max(int(whole.sum() - b), 1) for a, b in zip(kept, whole, strict=True)]
    mean = sum(without) / _BLOCKS
    variance = (_BLOCKS - 1) / _BLOCKS * sum((each - mean) * (each - mean) for each in without)
    return int(kept.sum()) / max(int(whole.sum()), 1), math.sqrt(variance)


def _dot(a: Floats, b: Floats) -> Any:
    """Returns the dot products of vectors, (n,), the same on every processor."""
    return (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]


def _cube_of(segments: Segments, frame: npt.NDArray[np.float32]) -> tuple[I64, int]:
    """Returns (the number of each segment's cube, the number of cubes)."""
    counts = frame[COUNT:].astype(np.int64)
    x, y, z = cubes_of(segments.point.astype(np.float32), frame).T
    return (x * counts[1] + y) * counts[2] + z, int(counts.prod())


def _parents(frame: npt.NDArray[np.float32], level: int) -> tuple[I64, int]:
    """Returns (for each cube of a level its cube of the next, which has twice the size; the number of those)."""
    counts = frame[COUNT:].astype(np.int64)
    fine = _ceil_shift(counts, level)
    coarse = _ceil_shift(counts, level + 1) if level + 1 < _LEVELS else np.ones(3, np.int64)
    i, j, k = _places(np.arange(int(fine.prod())), fine)
    shift = 1 if level + 1 < _LEVELS else 62
    return ((i >> shift) * coarse[1] + (j >> shift)) * coarse[2] + (k >> shift), int(coarse.prod())


def _ceil_shift(counts: I64, level: int) -> I64:
    shifted: I64 = -(-counts >> level)
    return shifted


def _places(number: I64, counts: I64) -> tuple[I64, I64, I64]:
    """Returns the coordinates of cubes from their numbers."""
    rest, z = np.divmod(number, counts[2])
    x, y = np.divmod(rest, counts[1])
    return x, y, z


def _parts(segments: Segments, cube: I64, cubes: int) -> F64:
    """Returns each segment's estimate of the irradiance over the mean of its cube, (n,)."""
    light = segments.radiance * segments.solid * segments.cosine
    if not light.any():
        return light
    units, unit = integers(light)
    mean = sums(cube, units, cubes) * unit / np.maximum(np.bincount(cube, minlength=cubes), 1)
    return light / np.maximum(mean, unit)[cube]


def _find(segments: Segments, part: F64) -> list[F64]:
    """Returns the portals, each (PORTAL_COLUMNS,). part: of `_parts`, not all 0."""
    turns = integers(part)[0].cumsum()
    turns = turns * _DRAWN // turns[-1]
    drawn = np.flatnonzero(np.diff(turns, prepend=0))
    number = np.diff(turns, prepend=0)[drawn]
    of = Segments(*(column[drawn].astype(np.float64) for column in segments))
    ended = of.length < _FAR
    points = np.concatenate((of.point, of.point[ended] + of.length[ended, None] * of.direction[ended]))
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    low, high = low - _MARGIN * longest, high + _MARGIN * longest
    if not longest > 0:
        return []
    grids = [Voxels(of.point, of.direction, of.length, low, high, (1 + 2 * _MARGIN) * longest / voxels) for voxels in _VOXELS]
    portals: list[F64] = []
    while len(portals) < MOST_PORTALS:
        most = [grid.largest(number) for grid in grids]
        scores = [count * count / (grid.size * math.sqrt(grid.size)) for (count, _), grid in zip(most, grids, strict=True)]
        best = int(np.argmax(scores))
        count, voxel = most[best]
        if count < _LEAST_PART * _DRAWN:
            break
        portal = np.zeros(PORTAL_COLUMNS)
        portal[:PORTAL_RADIUS], portal[PORTAL_RADIUS] = grids[best].center(voxel), _RADIUS * grids[best].size
        portal = _focused(portal, of, number)
        portals.append(portal)
        number = np.where(_crosses(portal, of), 0, number)
    return portals


def _focused(portal: F64, segments: Segments, number: I64) -> F64:
    """Returns a portal moved to where the segments through it come nearest to each other, and shrunk to nearly all of them.

    number: how often each segment counts.
    """
    through = np.flatnonzero(_crosses(portal, segments) & (number > 0))
    d, weight = segments.direction[through], number[through].astype(np.float64)
    offset = segments.point[through] - portal[:PORTAL_RADIUS]
    along = _dot(offset, d)
    across = offset - along[:, None] * d
    # The nearest point solves sum (I - d d^T) x = sum of the lines' offsets; Cramer's rule has the same bits everywhere.
    matrix = [[_total(weight * ((i == j) - d[:, i] * d[:, j])) for j in range(3)] for i in range(3)]
    right = [_total(weight * across[:, i]) for i in range(3)]
    whole = _determinant(matrix)
    if not abs(whole) > 1e-6 * _total(weight) ** 3:
        return portal
    moved = portal.copy()
    for j in range(3):
        moved[j] += _determinant([[right[i] if k == j else matrix[i][k] for k in range(3)] for i in range(3)]) / whole
    shift = moved[:PORTAL_RADIUS] - portal[:PORTAL_RADIUS]
    if _dot(shift[None], shift[None])[0] > (_MOST_SHIFT * portal[PORTAL_RADIUS]) ** 2:
        return portal
    from_line = across - shift + _dot(d, np.broadcast_to(shift, d.shape))[:, None] * d
    distance = np.sqrt(_dot(from_line, from_line))
    order = np.argsort(distance, kind="stable")
    counted = number[through][order].cumsum()
    reach = distance[order][np.searchsorted(counted, int(_KEPT * counted[-1]))]
    moved[PORTAL_RADIUS] = min(max(float(reach), _LEAST_SHRINK * portal[PORTAL_RADIUS]), portal[PORTAL_RADIUS])
    return moved


def _total(values: F64) -> float:
    """Returns a sum that is taken in order, with the same bits on every processor."""
    return float(values.cumsum()[-1])


def _determinant(m: list[list[float]]) -> float:
    (a, b, c), (d, e, f), (g, h, i) = m
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _crosses(portal: Floats, segments: Segments) -> Mask:
    """Returns which segments cross a portal from outside, (n,)."""
    to_center, radius = portal[:PORTAL_RADIUS] - segments.point, portal[PORTAL_RADIUS]
    along, square = _dot(to_center, segments.direction), _dot(to_center, to_center)
    hits = (along > 0) & (square - along * along <= radius * radius) & (along < segments.length + radius)
    crosses: Mask = hits & (square > MIN_DISTANCE2 * radius * radius)
    return crosses
