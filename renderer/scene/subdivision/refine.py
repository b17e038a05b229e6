"""Subdivides a cage several times, with the values at its corners, and moves its points to the limit surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.scene.subdivision.catmull_clark import Cage, limit, refined
from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces

__all__ = ["boundary_faces", "subdivide"]

MAX_REFINED = 4_000_000  # maximum number of triangles after subdivision
_SHARP = 10.0


def subdivide(
    cage: Cage, attributes: dict[str, AtCorners], face_varying: str, levels: int
) -> tuple[npt.NDArray[np.float64], Faces, dict[str, AtCorners], Codes]:
    """Subdivides a cage. Returns the new points, faces and attributes, and the original face of each new face.

    attributes: values at corners; those that are indexed are smoothed like points, with borders where neighbours do not share
    them. face_varying: their rule, a value of UsdGeomMesh's faceVaryingLinearInterpolation. levels: fewer are taken if there
    would be more than MAX_REFINED triangles.
    """
    old = np.arange(len(cage.faces.counts))
    along = attributes
    own = {
        name: _face_varying_cage(cage, values, face_varying)
        for name, values in along.items()
        if values.is_indexed and face_varying != "all"
    }
    along = {name: values for name, values in along.items() if name not in own}
    level = 0
    while level < levels and 2 * 4 * len(cage.faces.corners) <= 4 * MAX_REFINED:
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
    return cage.points, cage.faces, along, old


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
