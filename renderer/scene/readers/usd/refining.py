"""Subdivides USD meshes and their primvars."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32
from renderer.scene.subdivision.catmull_clark import Cage
from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces
from renderer.scene.subdivision.refine import subdivide

__all__ = ["refine"]

MAX_LEVEL = 2


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
    how = str(mesh.GetFaceVaryingLinearInterpolationAttr().Get(time))
    fine, faces, along, parent = subdivide(cage, along, how, MAX_LEVEL)
    at = 3
    for name, given in smooth.items():
        width = given.values.shape[1]
        along[name] = AtCorners(fine[:, at : at + width].astype(np.float32), faces.corners, True)
        at += width
    return np.ascontiguousarray(fine[:, :3], np.float32), faces, along, old[parent]


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
