"""One sample's path as a person reads it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.film import COLOR, SAMPLES, BatchSums
from renderer.kernel.integrators import record
from renderer.settings import Vec3

__all__ = ["Replay", "Vertex", "read_log"]


class Vertex(NamedTuple):
    """What a path's ray met. Colours are linear Rec.709, places in world space."""

    kind: str  # surface; passed: one that its alpha let the ray through; missed: the environment
    object: int | None  # numbers, as in the film less one; None where nothing was met
    material: int | None
    distance: float  # from the last vertex
    pdf: float | None  # per steradian, with which the BSDF gave the direction; None: the camera's, a single one, or not weighed
    point: Vec3 | None  # None where nothing was met
    normal: Vec3 | None  # unit, on the viewer's side, before any normal map
    direction: Vec3  # unit, in which the ray came
    throughput: Vec3  # what radiance from here counts
    emitted: Vec3  # the radiance that the vertex's own light adds to the sample
    direct: Vec3  # the radiance that the lights it sees add through it


class Replay(NamedTuple):
    """A sample's value, as the film got it to the bit, and its path from the camera on.

    value is None where the sample was NaN or infinite and so left out of the film.
    """

    value: Vec3 | None
    vertices: list[Vertex]


_KINDS = {record.SURFACE: "surface", record.PASSED: "passed", record.MISSED: "missed"}


def _vec(row: npt.NDArray[np.float64], column: int) -> Vec3:
    x, y, z = (float(v) for v in row[column : column + 3])
    return x, y, z


def _vertex(row: npt.NDArray[np.float64]) -> Vertex:
    kind = int(row[record.KIND])
    met = kind != record.MISSED
    before, emitted, direct = (np.array(_vec(row, c)) for c in (record.BEFORE, record.EMITTED, record.DIRECT))
    with np.errstate(invalid="ignore"):  # an infinite radiance less itself
        own, seen = emitted - before, direct - emitted
    return Vertex(
        kind=_KINDS[kind],
        object=int(row[record.OBJECT]) - 1 if met else None,
        material=int(row[record.MATERIAL]) - 1 if met else None,
        distance=float(row[record.DISTANCE]),
        pdf=float(row[record.PDF]) if row[record.PDF] > 0 else None,
        point=_vec(row, record.POINT) if met else None,
        normal=_vec(row, record.NORMAL) if met else None,
        direction=_vec(row, record.DIRECTION),
        throughput=_vec(row, record.THROUGHPUT),
        emitted=(float(own[0]), float(own[1]), float(own[2])),
        direct=(float(seen[0]), float(seen[1]), float(seen[2])),
    )


def read_log(batch: BatchSums, film_exponent: int, log: npt.NDArray[np.float64]) -> Replay:
    """The replay that a batch of one sample and its log tell: rows as renderer/kernel/integrators/record.py writes them."""
    value = None
    if batch.sums[SAMPLES, 0, 0] == 1:
        red, green, blue = (float(v) * 2.0**-film_exponent for v in batch.sums[COLOR, 0, 0])
        value = (red, green, blue)
    return Replay(value, [_vertex(row) for row in log if row[record.KIND] != record.UNSEEN])
