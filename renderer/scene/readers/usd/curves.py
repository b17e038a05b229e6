"""USD's curves as tubes, and its points as spheres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from renderer.scene.description import F32, Mesh
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.notes import Notes

__all__ = ["Balls", "balls_of", "tubes_of"]

F64 = npt.NDArray[np.float64]
MAX_VERTICES = 1 << 25
_STEPS = 6  # lines that a cubic segment is cut into
_FEW = 500  # curves that are drawn rounder than many

_BASES = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], np.float64),
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], np.float64) / 6,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], np.float64) / 2,
}


class Balls:
    """Spheres at points, in the prim's own space."""

    def __init__(self, centers: F32, radii: F32, colors: F32 | None) -> None:
        self.centers, self.radii, self.colors = centers, radii, colors


def balls_of(prim: Any, time: Any) -> Balls:
    """The points of a prim; those without a width are 1 across, as USD has it."""
    points = UsdGeom.Points(prim)
    centers = primvars.array(points.GetPointsAttr().Get(time), 3)
    widths = primvars.array(_widths(prim, points, time), 1)[:, 0]
    if len(widths) not in (1, len(centers)):
        widths = np.ones(1, np.float32)
    radii = np.broadcast_to(widths / 2, len(centers)).astype(np.float32)
    primvar = primvars.found(prim, "displayColor")
    colors = None if primvar is None else primvars.array(primvar.ComputeFlattened(time), 3)
    sound = np.isfinite(centers).all(axis=1) & np.isfinite(radii) & (radii > 0)
    if colors is not None and len(colors) == len(centers):
        return Balls(centers[sound], radii[sound], colors[sound])
    return Balls(centers[sound], radii[sound], None)


def _widths(prim: Any, points: Any, time: Any) -> Any:
    primvar = primvars.found(prim, "widths")
    return points.GetWidthsAttr().Get(time) if primvar is None else primvar.ComputeFlattened(time)


def tubes_of(prim: Any, time: Any, notes: Notes, color: str | None) -> Mesh | None:
    """All curves of a prim as one mesh of tubes; None, with a note, where they are damaged. color: the primvar of theirs."""
    curves = UsdGeom.BasisCurves(prim)
    points = primvars.array(curves.GetPointsAttr().Get(time), 3).astype(np.float64)
    counts = np.asarray(curves.GetCurveVertexCountsAttr().Get(time) or (), np.int64)
    kind, basis, wrap = (str(a.Get(time)) for a in (curves.GetTypeAttr(), curves.GetBasisAttr(), curves.GetWrapAttr()))
    basis = "linear" if kind == "linear" else basis
    path = str(prim.GetPath())
    if len(counts) == 0 or counts.min() < 0 or counts.sum() != len(points) or not np.isfinite(points).all():
        notes.add("Curves that are damaged are left out", path)
        return None
    if basis != "linear" and basis not in _BASES:
        notes.add(f"Curves of the basis {basis} are drawn straight from point to point", path)
        basis = "linear"
    interpolation = curves.GetWidthsInterpolation()
    primvar = primvars.found(prim, "widths")
    if primvar is not None:
        interpolation = primvar.GetInterpolation()
    widths = primvars.array(_widths(prim, curves, time), 1).astype(np.float64)
    if len(widths) == 0:
        widths, interpolation = np.ones((1, 1)), "constant"
    tint = primvars.found(prim, color) if color else None
    colors = None if tint is None else primvars.array(tint.ComputeFlattened(time), 3).astype(np.float64)
    sides = 12 if len(counts) <= _FEW else 4
    pieces = []
    total = 0
    for count in np.unique(counts):
        weights, between = _weights(int(count), basis, wrap)
        which = np.flatnonzero(counts == count)
        total += len(which) * (len(weights) + 2) * (sides + 1)
        if total > MAX_VERTICES:
            notes.add("Curves of which there are too many are left out", path)
            break
        if len(weights) < 2:
            continue
        first = (np.cumsum(counts) - counts)[which]
        own = points[first[:, None] + np.arange(count)]
        lines = np.einsum("sc,ncx->nsx", weights, own)
        radii = _along(widths, interpolation, which, first, counts, weights, between)[..., 0] / 2
        shown = None
        if colors is not None and tint is not None:
            shown = _along(colors, tint.GetInterpolation(), which, first, counts, weights, between)
        pieces.append(_tubes(lines, np.maximum(radii, 0), shown, sides))
    if not pieces:
        return None
    offsets = np.cumsum([0, *(len(p[0]) for p in pieces)])
    triangles = np.concatenate([p[3] + o for p, o in zip(pieces, offsets, strict=False)]).astype(np.int32)
    positions, normals = (np.concatenate([p[k] for p in pieces]).astype(np.float32) for k in (0, 1))
    mesh = Mesh(prim.GetName(), positions, triangles, normals)
    if all(p[2] is not None for p in pieces):
        mesh.colors = np.ones((len(positions), 4), np.float32)
        mesh.colors[:, :3] = np.clip(np.concatenate([p[2] for p in pieces]), 0, 1)
    return mesh


def _weights(count: int, basis: str, wrap: str) -> tuple[F64, F64]:
    """(samples, count): what samples along a curve are of its points; and (samples, varying) of its values at segments' ends."""
    if basis == "linear":
        closed = wrap == "periodic" and count > 2
        lines = np.eye(count)
        return (np.concatenate([lines, lines[:1]]),) * 2 if closed else (lines, lines)
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        segments, index = count // step, lambda k: k % count
    elif wrap == "pinned" and basis != "bezier":
        segments, index = count - 1, lambda k: k - 1
    else:
        segments, index = (count - 4) // step + 1, lambda k: k
    if count < (2 if wrap == "pinned" else 3) or segments < 1:
        return np.zeros((0, count)), np.zeros((0, 1))
    rows, ends = [], []
    varying = segments if wrap == "periodic" else segments + 1
    for s in range(segments):
        last = s == segments - 1
        for u in np.arange(_STEPS + last) / _STEPS:
            own = np.array([1, u, u * u, u**3]) @ _BASES[basis]
            row, end = np.zeros(count), np.zeros(varying)
            for k in range(4):
                at = index(s * step + k)
                # Beyond the ends of a pinned curve lie points that have it begin and end at its own: 2 p0 - p1.
                if at < 0:
                    row[0] += 2 * own[k]
                    row[1] -= own[k]
                elif at >= count:
                    row[count - 1] += 2 * own[k]
                    row[count - 2] -= own[k]
                else:
                    row[at] += own[k]
            end[s] += 1 - u
            end[(s + 1) % varying] += u
            rows.append(row)
            ends.append(end)
    return np.array(rows), np.array(ends)


def _along(
    values: F64,
    interpolation: str,
    which: npt.NDArray[np.int64],
    first: npt.NDArray[np.int64],
    counts: npt.NDArray[np.int64],
    weights: F64,
    between: F64,
) -> F64:
    """(curves, samples, w) values along some curves; the first one everywhere where they do not fit."""
    samples, varying = len(weights), between.shape[1]
    shape = (len(which), samples, values.shape[1])
    if interpolation == "uniform" and len(values) == len(counts):
        return np.broadcast_to(values[which][:, None], shape)
    if interpolation == "vertex" and len(values) == counts.sum():
        own = values[first[:, None] + np.arange(weights.shape[1])]
        return np.einsum("sc,ncx->nsx", weights, own)
    if interpolation == "varying" and (counts == counts[which[0]]).all() and len(values) == varying * len(counts):
        return np.einsum("sc,ncx->nsx", between, values.reshape(len(counts), varying, -1)[which])
    if interpolation in ("varying", "vertex") and len(values) == counts.sum() and weights.shape == between.shape:
        return np.einsum("sc,ncx->nsx", weights, values[first[:, None] + np.arange(weights.shape[1])])
    return np.broadcast_to(values[0], shape)


def _tubes(lines: F64, radii: F64, colors: F64 | None, sides: int) -> tuple[F64, F64, F64 | None, npt.NDArray[np.int64]]:
    """(positions, normals, colours, triangles) of tubes around (N, S, 3) lines, with flat ends."""
    count, samples = lines.shape[:2]
    tangents = np.empty_like(lines)
    tangents[:, 1:-1] = lines[:, 2:] - lines[:, :-2]
    tangents[:, 0], tangents[:, -1] = lines[:, 1] - lines[:, 0], lines[:, -1] - lines[:, -2]
    tangents /= np.maximum(np.linalg.norm(tangents, axis=2, keepdims=True), 1e-30)
    across = np.empty_like(lines)
    least = np.eye(3)[np.argmin(np.abs(tangents[:, 0]), axis=1)]
    side = np.cross(tangents[:, 0], least)
    for s in range(samples):  # carried along without twisting
        side = side - tangents[:, s] * np.einsum("ni,ni->n", side, tangents[:, s])[:, None]
        side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-30)
        across[:, s] = side
    third = np.cross(tangents, across)
    angle = np.arange(sides) * (2 * np.pi / sides)
    out = across[:, :, None] * np.cos(angle)[:, None] + third[:, :, None] * np.sin(angle)[:, None]  # (N, S, sides, 3)
    rings = lines[:, :, None] + radii[:, :, None, None] * out
    ends = np.stack([rings[:, 0], rings[:, -1]], axis=1)
    facing = np.broadcast_to(np.stack([-tangents[:, 0], tangents[:, -1]], axis=1)[:, :, None], ends.shape)
    positions = np.concatenate([rings, ends], axis=1).reshape(-1, 3)
    normals = np.concatenate([out, facing], axis=1).reshape(-1, 3)
    shown = None
    if colors is not None:
        whole = np.concatenate([colors, colors[:, :1], colors[:, -1:]], axis=1)
        shown = np.repeat(whole.reshape(-1, colors.shape[2]), sides, axis=0)
    along, k = np.meshgrid(np.arange(samples - 1), np.arange(sides), indexing="ij")
    a, b = along * sides + k, along * sides + (k + 1) % sides
    body = np.stack([np.stack([a, b, b + sides], -1), np.stack([a, b + sides, a + sides], -1)]).reshape(-1, 3)
    fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=1)
    one = np.concatenate([body, samples * sides + fan[:, ::-1], (samples + 1) * sides + fan])
    triangles = (one[None] + (np.arange(count) * (samples + 2) * sides)[:, None, None]).reshape(-1, 3)
    return positions, normals, shown, triangles
