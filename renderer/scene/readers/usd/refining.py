"""Subdivides USD meshes and their primvars."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32
from renderer.scene.readers.usd.polygons import AtCorners, Codes, Faces
from renderer.scene.readers.usd.subdivision import Cage, limit, refined

__all__ = ["boundary_faces", "refine"]

MAX_LEVEL = 2
MAX_REFINED = 4_000_000  # maximum number of triangles after subdivision
_SHARP = 10.0


def refine(
    mesh: Any, points: F32, faces: Faces, attributes: dict[str, AtCorners], time: Any
) -> tuple[F32, Faces, dict[str, AtCorners], Codes]:
    """Subdivides a mesh. Returns the new points, faces and attributes, and the original face of each new face.

    Holes are subdivided as well; faces with fewer than 3 corners are removed.
    """
    old = np.arange(len(faces.counts))
    whole = faces.counts >= 3
    faces, corners = faces.masked(whole)
    attributes, old = {name: values.at_corners(corners) for name, values in attributes.items()}, old[whole]
    smooth = {name: values for name, values in attributes.items() if values.by_point and len(values.values) > 1}
    columns = [points.astype(np.float64)]
    for values in smooth.values():
        at_points = np.zeros((len(points), values.values.shape[1]))
        at_points[faces.corners] = values.corner_values()
        columns.append(at_points)
    lengths = np.asarray(mesh.GetCreaseLengthsAttr().Get(time) or (), np.int64)
    edges, sharpness = _creases(
        np.asarray(mesh.GetCreaseIndicesAttr().Get(time) or (), np.int64),
        lengths,
        np.asarray(mesh.GetCreaseSharpnessesAttr().Get(time) or (), np.float64),
        len(points),
    )
    still = np.asarray(mesh.GetCornerIndicesAttr().Get(time) or (), np.int64)
    strength = np.asarray(mesh.GetCornerSharpnessesAttr().Get(time) or (), np.float64)
    known = (still >= 0) & (still < len(points)) if len(still) == len(strength) else np.zeros(len(still), bool)
    strength = strength[known] if len(still) == len(strength) else np.zeros(0)
    is_cornered = mesh.GetInterpolateBoundaryAttr().Get(time) != "edgeOnly"
    smooth_triangles = mesh.GetTriangleSubdivisionRuleAttr().Get(time) == "smooth"
    is_loop = mesh.GetSubdivisionSchemeAttr().Get() == "loop"
    cage = Cage(
        np.concatenate(columns, axis=1), faces, edges, sharpness, still[known], strength, is_cornered, is_loop, smooth_triangles
    )
    along = {name: values for name, values in attributes.items() if name not in smooth}
    # Indexed face-varying values shared by neighbours are smoothed like points.
    how = str(mesh.GetFaceVaryingLinearInterpolationAttr().Get(time))
    own = {name: _face_varying_cage(cage, values, how) for name, values in along.items() if values.is_indexed and how != "all"}
    along = {name: values for name, values in along.items() if name not in own}
    level = 0
    while level < MAX_LEVEL and 2 * 4 * len(cage.faces.corners) <= 4 * MAX_REFINED:
        cage, finer, parent = refined(cage, list(along.values()))
        along = dict(zip(along, finer, strict=True))
        own = {name: refined(one, [])[0] for name, one in own.items()}
        old = old[parent]
        level += 1
    if level:
        cage = replace(cage, points=limit(cage))
    for name, one in own.items():
        ends = limit(one) if level else one.points
        along[name] = AtCorners(ends.astype(np.float32), one.faces.corners)
    at = 3
    for name, given in smooth.items():
        width = given.values.shape[1]
        along[name] = AtCorners(cage.points[:, at : at + width].astype(np.float32), cage.faces.corners, True)
        at += width
    return np.ascontiguousarray(cage.points[:, :3], np.float32), cage.faces, along, old


def _creases(
    indices: Codes, lengths: Codes, sharpness: npt.NDArray[np.float64], points: int
) -> tuple[Codes, npt.NDArray[np.float64]]:
    """Returns (E, 2) crease edges and (E,) their sharpness; empty if the crease data does not fit the mesh.

    indices, lengths: chains of points; sharpness: one value per chain or per edge; points: the mesh's point count.
    """
    none = np.zeros((0, 2), np.int64), np.zeros(0)
    if len(lengths) == 0 or lengths.min() < 2 or lengths.sum() != len(indices):
        return none
    if indices.min() < 0 or indices.max() >= points:
        return none
    is_last = np.zeros(len(indices), bool)
    is_last[np.cumsum(lengths) - 1] = True
    begin = np.flatnonzero(~is_last)
    if len(sharpness) == len(lengths):
        sharpness = np.repeat(sharpness, lengths - 1)
    if len(sharpness) != len(begin):
        return none
    return np.stack([indices[begin], indices[begin + 1]], axis=1), np.maximum(sharpness, 0)


def _face_varying_cage(cage: Cage, values: AtCorners, interpolation: str) -> Cage:
    """Returns a cage whose points are the values of a face-varying primvar, to subdivide the primvar like positions.

    Where neighbouring faces do not share a value, the cage has a border. interpolation: UsdGeomMesh's
    faceVaryingLinearInterpolation, any value but `all`.
    """
    old, code = cage.faces.corners, values.code
    keys, first, corner = np.unique(old * (int(code.max(initial=0)) + 1) + code, return_index=True, return_inverse=True)
    point = old[first]  # the point of each value
    begin, end = np.searchsorted(point, np.arange(len(cage.points))), np.searchsorted(point, np.arange(len(cage.points)), "right")
    still = np.zeros(len(keys), bool)
    pieces, sides = end - begin, np.bincount(corner, minlength=len(keys))
    if interpolation in ("cornersPlus1", "cornersPlus2"):
        still = pieces[point] > 2
    if interpolation == "cornersPlus2":  # with two pieces, both are sharp if one has a corner
        still |= (pieces == 2)[point] & (np.bincount(point, sides == 1, len(cage.points)) > 0)[point]
    if interpolation == "none" and cage.sharp_boundary_corners:  # at corners of the mesh itself
        still = np.bincount(old, minlength=len(cage.points))[point] == 1
    faces = Faces(cage.faces.counts, corner)
    if interpolation == "boundaries":
        still = still | _boundary_points(faces, len(keys))
    ahead = np.arange(len(old)) + 1
    ahead[faces.first_corners + faces.counts - 1] = faces.first_corners
    edges, sharpness = np.zeros((0, 2), np.int64), np.zeros(0)
    if len(cage.edges):
        count = len(cage.points)
        lines = np.minimum(old, old[ahead]) * count + np.maximum(old, old[ahead])
        creased = cage.edges.min(axis=1) * count + cage.edges.max(axis=1)
        order = np.argsort(creased, kind="stable")
        at = np.minimum(np.searchsorted(creased[order], lines), len(creased) - 1)
        which = np.flatnonzero(creased[order][at] == lines)
        edges, sharpness = np.stack([corner[which], corner[ahead[which]]], axis=1), cage.edge_sharpness[order][at[which]]
    corners, strength = np.flatnonzero(still), np.full(int(still.sum()), _SHARP)
    if len(cage.corners):
        of = dict(zip(cage.corners.tolist(), cage.corner_sharpness.tolist(), strict=True))
        own = np.flatnonzero(np.isin(point, cage.corners))
        corners, strength = np.append(corners, own), np.append(strength, [of[int(p)] for p in point[own]])
    return Cage(
        values.values[code[first]].astype(np.float64),
        faces,
        edges,
        sharpness,
        corners,
        strength,
        interpolation != "none",
        cage.is_loop,
        cage.has_smooth_triangles,
    )


def boundary_faces(faces: Faces) -> npt.NDArray[np.bool_]:
    """Returns (F,) a mask of the faces: True for those with a point on the mesh's border."""
    outer = _boundary_points(faces, int(faces.corners.max(initial=-1)) + 1)
    found: npt.NDArray[np.bool_] = np.bincount(faces.face, outer[faces.corners], len(faces.counts)) > 0
    return found


def _boundary_points(faces: Faces, points: int) -> npt.NDArray[np.bool_]:
    """Returns (P,) a mask of the points: True for the end points of edges that belong to a single face."""
    ahead = np.arange(len(faces.corners)) + 1
    some = faces.counts > 0
    ahead[(faces.first_corners + faces.counts - 1)[some]] = faces.first_corners[some]
    a, b = faces.corners, faces.corners[ahead]
    keys, times = np.unique(np.minimum(a, b) * points + np.maximum(a, b), return_counts=True)
    outer = np.zeros(points, bool)
    single = keys[times == 1]
    outer[single // points], outer[single % points] = True, True
    return outer
