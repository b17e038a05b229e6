"""Converts pbrt's curves to polylines."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.strands import Strand, line_of
from renderer.scene.readers.tubes import STEPS
from renderer.sentences import Sentence

__all__ = ["is_flat", "strand_of"]

F64 = npt.NDArray[np.float64]


def is_flat(source: Parameters) -> bool:
    """Returns True if a curve is of the type flat, pbrt's default: it faces each ray."""
    return source.text("type", "flat") == "flat"


def strand_of(source: Parameters, notes: Notes) -> Strand:
    """Returns a curve as a polyline with radii; of the type ribbon, with the directions that it faces.

    Raises SceneError if its basis, degree, or number of points or normals is invalid.
    """
    points = source.numbers("P", "point3", "point")
    degree, basis = source.integer("degree", 3), source.text("basis", "bezier")
    kind = source.text("type", "flat")
    if kind not in ("cylinder", "flat", "ribbon"):
        notes.add(
            source.place,
            Sentence("pbrt-curve-type-replaced", "curves of type {kind} are rendered as tubes of the same width", kind=kind[:20]),
        )
    normals = source.numbers("N", "normal3", "normal")
    source.used.add("splitdepth")
    if basis not in ("bezier", "bspline") or degree not in (2, 3):
        raise source.place.error(
            Sentence("pbrt-curve-basis-unknown", "a curve needs the basis bezier or bspline, and the degree 2 or 3")
        )
    least = degree + 1
    if points is None or len(points) < least or (basis == "bezier" and (len(points) - 1) % degree):
        raise source.place.error(
            Sentence(
                "pbrt-curve-points-too-few",
                "a curve of degree {degree} needs {least} points, and a bezier curve {degree} more for each further segment",
                degree=degree,
                least=least,
            )
        )
    width = source.number("width", 1.0)
    wide = np.array([source.number("width0", width), source.number("width1", width)])
    segments = (len(points) - 1) // degree if basis == "bezier" else len(points) - degree
    if degree == 2:
        points, basis = _cubic(points, basis), "bezier"
    line = line_of(points, basis)
    share = np.linspace(0, 1, len(line))
    radii = np.maximum(wide[0] * (1 - share) + wide[1] * share, 0) / 2
    if kind != "ribbon":
        return Strand(line, radii, steps=STEPS)
    if normals is None or len(normals) != segments + 1:
        raise source.place.error(
            Sentence(
                "pbrt-curve-normals-wrong",
                "a curve of the type ribbon needs a normal N for each end of its {segments} segments",
                segments=segments,
            )
        )
    return Strand(line, radii, _turned(normals, share * segments), STEPS)


def _turned(normals: F64, at: F64) -> F64:
    """Returns (S, 3) directions between (n + 1, 3) normals, turned evenly from each to the next. at: (S,) in 0..n."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    segment = np.minimum(at.astype(np.int64), len(unit) - 2)
    u = (at - segment)[:, None]
    first, last = unit[segment], unit[segment + 1]
    angle = np.arccos(np.clip((first * last).sum(axis=1, keepdims=True), 0.0, 1.0))  # clipped as by pbrt
    sine = np.sin(angle)
    is_bent = sine > 1e-6
    low, high = (np.where(is_bent, np.sin(w * angle) / np.where(is_bent, sine, 1), w) for w in (1 - u, u))
    return np.asarray(low * first + high * last)


def _cubic(points: F64, basis: str) -> F64:
    """Returns the control points of cubic Bezier curves that are equal to quadratic curves.

    basis: basis of the quadratic curves.
    """
    if basis == "bspline":
        ends = (points[:-1] + points[1:]) / 2
        points = np.insert(ends, np.arange(1, len(ends)), points[1:-1], axis=0)
    first, middle, last = points[:-1:2], points[1::2], points[2::2]
    inner = np.stack([first, (first + 2 * middle) / 3, (2 * middle + last) / 3], axis=1)
    return np.concatenate([inner.reshape(-1, 3), last[-1:]])
