"""Converts USD curves to fibres of hair, tubes or ribbons, and USD points to spheres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from renderer.scene.description import F32, Mesh
from renderer.scene.readers import tubes as shapes
from renderer.scene.readers.polylines import by_stride
from renderer.scene.readers.tubes import (
    BASES,
    MAX_STEPS,
    MAX_VERTICES,
    STEPS,
    CurveWeights,
    Tubes,
    curve_segments,
    curve_weights,
    fineness_of,
    ribbons,
    sides_of,
    tubes,
    tubes_mesh,
    varying_values,
)
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.notes import Notes
from renderer.sentences import Sentence

__all__ = ["PointSpheres", "spheres_of_points", "tubes_of"]

F64 = npt.NDArray[np.float64]
_TOO_MANY = Sentence("usd-curves-too-many", "Curves beyond the limit are left out")
_WIDTHS = Sentence("usd-point-width-count-wrong", "Points whose number of widths is wrong are shown with width 1")


class PointSpheres:
    """The spheres of a Points prim, in its local space: (N, 3) centres, (N,) radii, and (N, 3) colours or None."""

    def __init__(self, centers: F32, radii: F32, colors: F32 | None) -> None:
        self.centers, self.radii, self.colors = centers, radii, colors


def spheres_of_points(prim: Any, time: Any, notes: Notes) -> PointSpheres:
    """Returns the spheres of a Points prim; points without a width get width 1."""
    points = UsdGeom.Points(prim)
    centers = primvars.array(points.GetPointsAttr().Get(time), 3)
    widths = primvars.array(_widths(prim, points, time), 1)[:, 0]
    path = str(prim.GetPath())
    if len(widths) not in (1, len(centers)):
        if len(widths):
            notes.add(_WIDTHS, path)
        widths = np.ones(1, np.float32)
    radii = np.broadcast_to(widths / 2, len(centers)).astype(np.float32)
    primvar = primvars.find_primvar(prim, "displayColor")
    colors = None if primvar is None else primvars.array(primvar.ComputeFlattened(time), 3)
    sound = np.isfinite(centers).all(axis=1) & np.isfinite(radii) & (radii > 0)
    if lost := int((~sound).sum()):
        notes.add(
            Sentence("usd-points-not-finite", "{count} points without a finite position or a width are left out", count=lost),
            path,
        )
    if colors is not None and len(colors) not in (1, len(centers)):
        notes.add(
            Sentence(
                "usd-point-colours-dropped",
                "The colours of points are left out: {colours} for {points}",
                colours=len(colors),
                points=len(centers),
            ),
            path,
        )
    if colors is not None and len(colors) == len(centers):
        return PointSpheres(centers[sound], radii[sound], colors[sound])
    return PointSpheres(centers[sound], radii[sound], None)


def _widths(prim: Any, points: Any, time: Any) -> Any:
    primvar = primvars.find_primvar(prim, "widths")
    return points.GetWidthsAttr().Get(time) if primvar is None else primvar.ComputeFlattened(time)


def tubes_of(
    prim: Any,
    time: Any,
    notes: Notes,
    color: str | None,
    uv_sets: tuple[str, ...] = (),
    fibres: bool = False,
    bends: bool = False,
) -> Mesh | None:
    """Returns all curves of a prim as one mesh: tubes, or ribbons if they have normals; None, with a note, if they are damaged.

    color: name of the primvar with their colours, or None. uv_sets: names of those with their UVs. fibres: whether their material
    is hair: they are then segments of round curves (tubes.py), with or without normals. bends: whether they deform over time.
    """
    curves = UsdGeom.BasisCurves(prim)
    points = primvars.array(curves.GetPointsAttr().Get(time), 3).astype(np.float64)
    counts = np.asarray(curves.GetCurveVertexCountsAttr().Get(time) or (), np.int64)
    kind, basis, wrap = (str(a.Get(time)) for a in (curves.GetTypeAttr(), curves.GetBasisAttr(), curves.GetWrapAttr()))
    basis = "linear" if kind == "linear" else basis
    path = str(prim.GetPath())
    if len(counts) == 0 or counts.min() < 0 or counts.sum() != len(points) or not np.isfinite(points).all():
        notes.add(Sentence("usd-curves-damaged", "Damaged curves are left out"), path)
        return None
    if basis != "linear" and basis not in BASES:
        notes.add(
            Sentence(
                "usd-curve-basis-replaced",
                "Curves of the basis {basis} are drawn as straight segments",
                basis=basis,
            ),
            path,
        )
        basis = "linear"
    interpolation = curves.GetWidthsInterpolation()
    primvar = primvars.find_primvar(prim, "widths")
    if primvar is not None:
        interpolation = primvar.GetInterpolation()
    widths = primvars.array(_widths(prim, curves, time), 1).astype(np.float64)
    if len(widths) == 0:
        widths, interpolation = np.ones((1, 1)), "constant"
    if not np.isfinite(widths).all():
        notes.add(Sentence("usd-curve-widths-not-finite", "Widths of curves that are not finite are replaced by 0"), path)
        widths = np.nan_to_num(widths, posinf=0.0, neginf=0.0)
    tint = primvars.find_primvar(prim, color) if color else None
    colors = None if tint is None else primvars.array(tint.ComputeFlattened(time), 3).astype(np.float64)
    uvs = [_uvs(prim, name, time) for name in uv_sets]
    sides = 0 if fibres else sides_of(len(counts), fibres)
    normals, facing = _normals(prim, curves, time)
    if fibres and len(normals):
        notes.add(Sentence("usd-ribbons-drawn-as-tubes", "Ribbons of hair are drawn as round fibres"), path)
        normals = normals[:0]
    spans = np.zeros(len(counts), np.int64)  # number of varying values per curve
    for count in np.unique(counts):
        spans[counts == count] = varying_values(int(count), basis, wrap)
    if surplus := _with_surplus_points(counts, basis, wrap):
        notes.add(
            Sentence(
                "usd-curve-points-surplus",
                "{curves} Bezier curves have points beyond their last segment, which are left out",
                curves=surplus,
            ),
            path,
        )
    expected = {"uniform": len(counts), "varying": spans.sum(), "vertex": len(points)}.get(str(interpolation), 1)
    if len(widths) not in (1, expected):
        notes.add(
            Sentence("usd-curve-width-count-wrong", "Curves whose number of widths is wrong have the first width all along"), path
        )
        widths = widths[:1]
    pieces: list[Tubes] = []
    total = along_all = 0
    for count in np.unique(counts):
        along_all += int(count) if basis == "linear" else curve_segments(int(count), basis, wrap) * STEPS
        if along_all > MAX_STEPS:
            notes.add(_TOO_MANY, path)
            break
        weights, between = curve_weights(int(count), basis, wrap)
        which = np.flatnonzero(counts == count)
        if weights.samples < 2:
            notes.add(
                Sentence(
                    "usd-curves-too-short",
                    "{curves} curves of {points} points are too short and left out",
                    curves=len(which),
                    points=count,
                ),
                path,
            )
            continue
        if total + len(which) * (2 + 2) * (sides + 1) > MAX_VERTICES:  # even if each has two points: not even interpolated
            notes.add(_TOO_MANY, path)
            break
        first = (np.cumsum(counts) - counts)[which]
        own = points[first[:, None] + np.arange(count)]
        lines = weights.interpolate(own)
        along = which, first, spans, weights, between
        radii = np.maximum(_values_along(widths, interpolation, *along)[..., 0] / 2, 0)
        steps = STEPS if fibres and basis != "linear" else 1
        tolerance, most = fineness_of(len(counts))
        groups = list(by_stride(lines, radii, steps, None if bends else tolerance, most))
        total += sum(len(k) * (lines[0, kept].shape[0] + 2) * (sides + 1) for k, kept in groups)
        if total > MAX_VERTICES:
            notes.add(_TOO_MANY, path)
            break
        shown = None
        if colors is not None and tint is not None:
            shown = _values_along(colors, tint.GetInterpolation(), *along)
        placed = [_values_along(values, by, *along) for values, by in uvs]
        facings = _values_along(normals, facing, *along) if len(normals) else None
        for k, kept in groups:
            own_colors, own_uvs = None if shown is None else shown[k, kept], [each[k, kept] for each in placed]
            if facings is not None:
                pieces.append(ribbons(lines[k, kept], radii[k, kept], facings[k, kept], own_colors, own_uvs))
            elif fibres:
                pieces.append(shapes.fibres(lines[k, kept], radii[k, kept], own_colors, own_uvs))
            else:
                pieces.append(tubes(lines[k, kept], radii[k, kept], own_colors, sides, uvs=own_uvs))
    if not pieces:
        return None
    return tubes_mesh(prim.GetName(), pieces)


def _with_surplus_points(counts: npt.NDArray[np.int64], basis: str, wrap: str) -> int:
    """Returns the number of Bezier curves with one or two points after their last whole segment."""
    if basis != "bezier":
        return 0
    surplus = counts % 3 != (0 if wrap == "periodic" else 1)
    return int((surplus & (counts >= (3 if wrap == "periodic" else 4))).sum())


def _normals(prim: Any, curves: Any, time: Any) -> tuple[F64, str]:
    """Returns (N, 3) the normals of ribbons, none of tubes, and their interpolation."""
    primvar = primvars.find_primvar(prim, "normals")
    given = curves.GetNormalsAttr().Get(time) if primvar is None else primvar.ComputeFlattened(time)
    normals = primvars.array(given, 3).astype(np.float64)
    interpolation = curves.GetNormalsInterpolation() if primvar is None else primvar.GetInterpolation()
    return (normals if np.isfinite(normals).all() else normals[:0]), str(interpolation)


def _uvs(prim: Any, name: str, time: Any) -> tuple[F64, str]:
    """Returns (N, 2) the UVs of a primvar, and its interpolation; one UV of 0 without that primvar."""
    primvar = primvars.find_primvar(prim, name)
    uvs = np.zeros((0, 2)) if primvar is None else primvars.array(primvar.ComputeFlattened(time), 2).astype(np.float64)
    if primvar is None or not len(uvs) or not np.isfinite(uvs).all():
        return np.zeros((1, 2)), "constant"
    uvs[:, 1] = 1 - uvs[:, 1]
    return uvs, str(primvar.GetInterpolation())


def _values_along(
    values: F64,
    interpolation: str,
    curve_indices: npt.NDArray[np.int64],
    first: npt.NDArray[np.int64],
    spans: npt.NDArray[np.int64],
    weights: CurveWeights,
    between: CurveWeights,
) -> F64:
    """Interpolates a primvar along several curves that have the same number of points.

    curve_indices: (n,) indices of the curves; first: (n,) index of each curve's first point; spans: for each curve of the prim,
    its number of varying values; weights, between: those of vertex and of varying values.

    Returns (n, samples, w) values; the first value everywhere if the number of values does not fit the interpolation.
    """
    points = weights.length
    shape = (len(curve_indices), weights.samples, values.shape[1])
    if interpolation == "uniform" and len(values) == len(spans):
        return np.broadcast_to(values[curve_indices][:, None], shape)
    if interpolation == "varying" and len(values) == spans.sum():
        begin = (np.cumsum(spans) - spans)[curve_indices]
        return between.interpolate(values[begin[:, None] + np.arange(between.length)])
    if interpolation == "vertex" and len(values) >= int(first.max()) + points:
        return weights.interpolate(values[first[:, None] + np.arange(points)])
    return np.broadcast_to(values[0], shape)
