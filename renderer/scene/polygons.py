"""Triangulates polygons, for all readers of faces with more than three corners."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.ear_clipping import EarClipper

__all__ = ["Triangulation", "triangulate"]

Codes = npt.NDArray[np.int64]
_NOISE = 1e-6  # relative to a polygon's area: reversed triangles of collinear corners in 32-bit positions
Points = npt.NDArray[np.floating]


class Triangulation(NamedTuple):
    """Triangles that fill polygons, in the polygons' order and winding."""

    triangles: Codes  # (T, 3) indices into `corners`
    face: Codes  # (T,) the polygon of each
    unfilled: int  # concave polygons triangulated as fans because clipping them takes too long


def triangulate(counts: npt.NDArray[Any], corners: npt.NDArray[Any], points: Points) -> Triangulation:
    """Triangulates polygons of any number of corners. Those with fewer than three have no triangles.

    counts: (F,) number of corners of each polygon. corners: (C,) indices of points, polygon by polygon.

    Convex polygons become fans from their first corner. Concave quads are cut along their other diagonal, larger concave polygons
    by ear clipping. Every corner remains a vertex, so that adjacent polygons still share their edge.
    """
    counts = np.asarray(counts, np.int64)
    first = np.cumsum(counts) - counts
    if len(counts) and counts.min() == counts.max() == 3:
        return Triangulation(np.arange(len(corners)).reshape(-1, 3), np.arange(len(counts)), 0)
    number = np.maximum(counts - 2, 0)
    face = np.repeat(np.arange(len(counts)), number)
    start = np.cumsum(number) - number
    step = np.arange(len(face)) - start[face]
    fans = np.stack([first[face], first[face] + step + 1, first[face] + step + 2], axis=1)
    bent = np.flatnonzero(counts == 4)
    bent = bent[_concave_quads(corners, first[bent], points)]
    a = first[bent]
    fans[start[bent]] = np.stack([a, a + 1, a + 3], axis=1)
    fans[start[bent] + 1] = np.stack([a + 1, a + 2, a + 3], axis=1)
    scissors, unfilled = EarClipper(), 0
    for k in _polygons_not_filled_by_fan(counts, corners, points):
        at, n = int(first[k]), int(counts[k])
        if not scissors.are_blunt:
            cut = scissors.triangulate(points[corners[at : at + n]].astype(np.float64))
            if not scissors.are_blunt:
                fans[start[k] : start[k] + n - 2] = at + cut
        unfilled += scissors.are_blunt
    return Triangulation(fans, face, unfilled)


def _concave_quads(corners: npt.NDArray[Any], begin: Codes, points: Points) -> npt.NDArray[np.bool_]:
    """Returns a mask of the quads that must be cut along their other diagonal, since a fan's triangles would face each other.

    begin: the first corner of each quad.
    """
    if len(begin) == 0:
        return np.zeros(0, bool)
    a, b, c, d = (points[corners[begin + k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0


def _polygons_not_filled_by_fan(counts: Codes, corners: npt.NDArray[Any], points: Points) -> Codes:
    """Returns the indices of the polygons with five or more corners whose triangulation as a fan has reversed triangles."""
    large = np.flatnonzero(counts > 4)
    if len(large) == 0:
        return large
    count = counts[large]
    begin = np.cumsum(count) - count
    of = np.repeat(np.arange(len(large)), count)
    chosen = np.repeat((np.cumsum(counts) - counts)[large] - begin, count) + np.arange(len(of))
    place = points[corners[chosen]].astype(np.float64)
    along = np.arange(len(of)) + 1
    along[begin + count - 1] = begin
    origin = place[begin][of]
    fan = np.cross(place - origin, place[along] - origin)
    # Newell's normal, as long as twice the polygon's area.
    normal = np.stack([np.bincount(of, fan[:, k], len(large)) for k in range(3)], axis=1)
    against = np.minimum(np.einsum("ij,ij->i", fan, normal[of]), 0.0)
    return large[-np.bincount(of, against, len(large)) > _NOISE * np.einsum("ij,ij->i", normal, normal)]
