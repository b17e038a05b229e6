"""Converts the kernel's record of one sample's path to readable objects."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.film import COLOR, SAMPLES, BatchSums
from renderer.kernel import path_trace as record
from renderer.kernel.steps.continue_or_end import UNCOUNTED
from renderer.kernel.steps.depths import DIFFUSE_LIMIT, GLOSSY_LIMIT, TRANSMISSION_LIMIT
from renderer.settings import MAX_DEPTH, RenderSettings, Vec3

__all__ = ["ENDS", "End", "LightSample", "Replay", "Vertex", "read_log"]

End = Literal["missed", "absorbed", "roulette", "depth", "diffuse", "glossy", "transmission", "caught", "unlit", "passed"]
ENDS: dict[End, str] = {
    "missed": "it left the scene",
    "absorbed": "nothing was left of it",
    "roulette": "Russian roulette ended it",
    "depth": "it has as many segments as the settings allow",
    "diffuse": "it has as many diffuse bounces as the settings allow",
    "glossy": "it has as many glossy bounces as the settings allow",
    "transmission": "it has passed as much glass as the settings allow",
    "caught": "it left too many surfaces without getting on",
    "unlit": "the material scatters no light",
    "passed": "it passed too many surfaces by their alpha",
}
_LIMIT_REASONS: dict[float, End] = {DIFFUSE_LIMIT: "diffuse", GLOSSY_LIMIT: "glossy", TRANSMISSION_LIMIT: "transmission"}
FAR = 1e17  # scene units; the kernel puts infinitely distant points slightly beyond


class LightSample(NamedTuple):
    """The light sample at a path's vertex: a point on a light chosen by next-event estimation."""

    point: Vec3 | None  # None: infinitely far
    direction: Vec3  # unit, towards the light
    pdf: float  # per steradian, of the light sample
    share: float  # MIS weight against the BSDF's sample of the same direction
    brought: Vec3  # the radiance added to the sample if unoccluded, including throughput and MIS weight


class Vertex(NamedTuple):
    """A vertex of a path: a surface hit, a surface passed because of its alpha, a point in a medium, or the environment.

    Colours are linear Rec.709, in spectral pictures light at the three wavelengths; positions are in world space.
    """

    kind: str  # surface; passed: a surface that the ray passed by alpha; medium: a point in a medium; missed: the environment
    object: int | None  # number, as in the film minus 1; None without a surface
    material: int | None
    distance: float  # from the previous vertex, scene units
    # Per steradian, of the BSDF's sample, or of one of two where the path had split; None: camera ray, discrete direction,
    # or without MIS.
    pdf: float | None
    point: Vec3 | None  # None for the environment
    normal: Vec3 | None  # unit, on the viewer's side, without normal map; None without a surface
    direction: Vec3  # unit, of the incoming ray
    throughput: Vec3  # factor of radiance from here to the sample
    emitted: Vec3  # the radiance of the vertex's own emission in the sample
    direct: Vec3  # the radiance of direct light at the vertex in the sample
    beside: Vec3  # the radiance of the path's other branch, if this vertex splits it
    # Only for the production path tracer (settings' `path` without options for comparisons), else None:
    share: float | None = None  # MIS weight of `emitted`; None also if it emits nothing
    lamp: LightSample | None = None  # None also without a light sample
    survival: float | None = None  # survival probability of Russian roulette; None also if not applied


class Replay(NamedTuple):
    """A sample's value, with the same bits as in the film, and its path from the camera on.

    value: None if the sample was NaN or infinite and so is not in the film.
    """

    value: Vec3 | None
    vertices: list[Vertex]
    end: End | None = None  # why the path ended (ENDS); None if unknown
    time: float = 0.0  # of the shutter, 0 ... 1; 0 if nothing moves or unknown


_KINDS = {record.SURFACE: "surface", record.PASSED: "passed", record.MISSED: "missed", record.IN_MEDIUM: "medium"}
_WORLD = np.zeros(3)
_BODIES = (record.SURFACE, record.PASSED)


def _vec(row: npt.NDArray[np.float64], column: int) -> Vec3:
    x, y, z = (float(v) for v in row[column : column + 3])
    return x, y, z


def _world_position(row: npt.NDArray[np.float64], column: int, origin: npt.NDArray[np.float64]) -> Vec3:
    x, y, z = (float(v + o) for v, o in zip(row[column : column + 3], origin, strict=True))
    return x, y, z


def _vertex(row: npt.NDArray[np.float64], origin: npt.NDArray[np.float64]) -> Vertex:
    kind = int(row[record.KIND])
    met = kind != record.MISSED
    before, emitted, direct = (np.array(_vec(row, c)) for c in (record.BEFORE, record.EMITTED, record.DIRECT))
    with np.errstate(invalid="ignore"):  # inf - inf
        own, seen = emitted - before, direct - emitted
    end = float(row[record.SURVIVAL])
    stage = int(row[record.RECORDED])
    return Vertex(
        share=float(row[record.EMISSION_WEIGHT]) if stage and np.any(own != 0) else None,
        lamp=_lamp(row, origin) if met and row[record.LIGHT_PDF] > 0 else None,
        survival=abs(end) if stage == record.SCATTERED and end not in (0.0, UNCOUNTED) else None,
        kind=_KINDS[kind],
        object=int(row[record.OBJECT]) - 1 if kind in _BODIES else None,
        material=int(row[record.MATERIAL]) - 1 if kind in _BODIES else None,
        distance=float(row[record.DISTANCE]),
        pdf=float(row[record.PDF]) if row[record.PDF] > 0 else None,
        point=_world_position(row, record.POINT, origin) if met else None,
        normal=_vec(row, record.NORMAL) if kind in _BODIES else None,
        direction=_vec(row, record.DIRECTION),
        throughput=_vec(row, record.THROUGHPUT),
        emitted=(float(own[0]), float(own[1]), float(own[2])),
        direct=(float(seen[0]), float(seen[1]), float(seen[2])),
        beside=_vec(row, record.SECOND_BRANCH),
    )


def _lamp(row: npt.NDArray[np.float64], origin: npt.NDArray[np.float64]) -> LightSample:
    end, point = np.array(_vec(row, record.LIGHT_AT)), np.array(_vec(row, record.POINT))
    away = float(np.linalg.norm(end - point))
    x, y, z = (float(v) for v in (end - point) / (away or 1.0))
    at = None if away >= FAR else _world_position(row, record.LIGHT_AT, origin)
    return LightSample(at, (x, y, z), float(row[record.LIGHT_PDF]), float(row[record.LIGHT_WEIGHT]), _vec(row, record.BROUGHT))


def _end_reason(row: npt.NDArray[np.float64], is_last: bool, settings: RenderSettings) -> End | None:
    """Returns why a path ends at the vertex that is recorded in `row`, a row of the path's log; None if the reason is unknown.

    is_last: whether no further segment was allowed.
    """
    stage = row[record.RECORDED]
    if row[record.KIND] == record.MISSED:
        return "missed"
    if not stage:
        return None
    if row[record.KIND] == record.PASSED:
        return "passed"
    if stage != record.SCATTERED:
        return "depth" if is_last else _LIMIT_REASONS.get(float(row[record.LIMIT]), "unlit")
    survival = row[record.SURVIVAL]
    if survival == UNCOUNTED:
        return "transmission" if settings.transmission_depth == MAX_DEPTH else "caught"  # that limit is not counted separately
    return "absorbed" if survival == 0 else "roulette"


def read_log(
    batch: BatchSums,
    settings: RenderSettings,
    log: npt.NDArray[np.float64],
    origin: npt.NDArray[np.float64] = _WORLD,
) -> Replay:
    """Returns the Replay of a batch of one sample. log: the record of its path, as written by renderer/kernel/path_trace.py.

    origin: of the compiled scene, to which the record's positions are relative.
    """
    value = None
    if batch.sums[SAMPLES, 0, 0] == 1:
        red, green, blue = (float(v) * 2.0**-settings.film_exponent for v in batch.sums[COLOR, 0, 0])
        value = (red, green, blue)
    rows = list(log[log[:, record.KIND] != record.UNSEEN])
    scattering = sum(row[record.KIND] in (record.SURFACE, record.IN_MEDIUM) for row in rows)
    end = _end_reason(rows[-1], scattering >= settings.max_depth, settings) if rows else None
    return Replay(value, [_vertex(row, origin) for row in rows], end, float(rows[0][record.TIME]) if rows else 0.0)
