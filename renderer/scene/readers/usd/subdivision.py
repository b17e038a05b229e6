"""Subdivision surfaces after Catmull and Clark, and after Loop, with semi-sharp creases.

Source: Catmull & Clark 1978; DeRose, Kass & Truong 1998, "Subdivision Surfaces in Character Animation", for the creases.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32
from renderer.scene.readers.usd import loop
from renderer.scene.readers.usd.polygons import AtCorners, Codes, Faces

__all__ = ["Cage", "limit", "refined"]

F64 = npt.NDArray[np.float64]
MAX_FURTHER, MAX_CORNERS = 4, 8_000_000
SMOOTH_TRIANGLE = 0.470  # as OpenSubdiv has it: a quarter otherwise
SHARP = 10.0  # as OpenSubdiv has it: sharp at every level


@dataclass(frozen=True)
class Cage:
    """What is refined. points: (P, w), positions first; all columns are smoothed alike."""

    points: F64
    faces: Faces
    edges: Codes  # (E, 2) points of edges that are creased
    edge_sharpness: F64  # (E,)
    corners: Codes  # points that are sharp
    corner_sharpness: F64
    sharp_boundary_corners: bool = True  # whether a point of one face alone stays where it is
    is_loop: bool = False  # of triangles, and refined after Loop
    has_smooth_triangles: bool = False  # whether edges beside triangles lie closer to their middles


class _Edges(NamedTuple):
    ends: Codes  # (E, 2)
    of: Codes  # (C,) the edge from each corner to the next
    sharpness: F64  # (E,)


def refined(cage: Cage, along: list[AtCorners]) -> tuple[Cage, list[AtCorners], Codes]:
    """One level finer: the cage, values at its corners, and which of the old faces each of the new ones is a part of.

    Values of corners are mixed within their face; those of points belong into the cage's points.
    """
    faces, points = cage.faces, cage.points
    ahead, back = _neighbours(faces)
    edges = _edges(cage, ahead)
    count, face = len(points), faces.face
    onto = points[edges.ends].mean(axis=1)
    if cage.is_loop:
        smooth = loop.on_edges(points, edges.ends, edges.of, faces.corners[back])
        old, new_points = loop.smoothed(points, edges.ends), np.zeros((0, points.shape[1]))
        finer_faces, parent = loop.split(faces.corners, count + edges.of)
        within = loop.within
    else:
        middle = _mean(points[faces.corners], face, len(faces.counts))
        beside = np.where(cage.has_smooth_triangles & (faces.counts[face] == 3), SMOOTH_TRIANGLE, 0.25)[:, None]
        share = 2 * _mean(beside, edges.of, len(edges.ends))
        smooth = (1 - share) * onto + share * _mean(middle[face], edges.of, len(edges.ends))
        old, new_points = _smoothed(cage, edges, middle, face), middle
        # Each corner becomes a face: itself, the middle of the edge ahead, that of the face, and the middle of the edge behind.
        quads = np.stack([faces.corners, count + edges.of, count + len(edges.ends) + face, count + edges.of[back]], axis=1)
        finer_faces, parent = Faces(np.full(len(quads), 4), quads.reshape(-1)), face
        within = _within
    share = np.clip(edges.sharpness, 0, 1)[:, None]
    on_edges = share * onto + (1 - share) * smooth
    moved = _points(cage, edges, old)

    kept = edges.sharpness > 1
    new = count + np.flatnonzero(kept)
    halves = np.concatenate([np.stack([edges.ends[kept, side], new], axis=1) for side in (0, 1)])
    finer = np.where(edges.sharpness[kept] >= SHARP, SHARP, edges.sharpness[kept] - 1)
    at_corner = np.where(cage.corner_sharpness >= SHARP, SHARP, cage.corner_sharpness - 1)
    result = Cage(
        np.concatenate([moved, on_edges, new_points]),
        finer_faces,
        halves,
        np.tile(finer, 2),
        cage.corners[at_corner > 0],
        at_corner[at_corner > 0],
        cage.sharp_boundary_corners,
        cage.is_loop,
    )
    return result, [within(each, faces, ahead, back) for each in along], parent


def limit(cage: Cage) -> F64:
    """(P, w) the same of any cage: what is half sharp is refined until it is not, as long as that takes no more than it may."""
    count, level = len(cage.points), 0
    while level < MAX_FURTHER and 4 * len(cage.faces.corners) <= MAX_CORNERS and _is_half_sharp(cage):
        cage, level = refined(cage, [])[0], level + 1
    return _limit(cage)[:count]


def _is_half_sharp(cage: Cage) -> bool:
    return any(bool(((sharp > 0) & (sharp < SHARP)).any()) for sharp in (cage.edge_sharpness, cage.corner_sharpness))


def _limit(cage: Cage) -> F64:
    """(P, w) where the points of a cage of quads, or Loop's of triangles, come to lie after infinitely many levels.

    Source: Halstead, Kass & DeRose 1993; of creases, the limit of cubic B-splines.
    """
    points, faces = cage.points, cage.faces
    ahead, _ = _neighbours(faces)
    edges = _edges(cage, ahead)
    count = len(points)
    ends, others = edges.ends.reshape(-1), edges.ends[:, ::-1].reshape(-1)
    n = np.bincount(ends, minlength=count).astype(np.float64)[:, None]
    opposite = faces.corners[ahead[ahead]]
    if cage.is_loop:
        smooth = loop.limit(points, edges.ends)
    else:
        around, across = _mean(points[others], ends, count), _mean(points[opposite], faces.corners, count)
        smooth = (n * points + 4 * around + across) / (n + 5)
    is_sharp = np.repeat(edges.sharpness > 0, 2)
    sharp = np.bincount(ends[is_sharp], minlength=count)[:, None]
    crease = (4 * points + 2 * _mean(points[others[is_sharp]], ends[is_sharp], count)) / 6
    still = _stillness(cage, edges, sharp[:, 0])[:, None]
    return np.where((still > 0) | (n == 0), points, np.where(sharp == 2, crease, smooth))


def _neighbours(faces: Faces) -> tuple[Codes, Codes]:
    """(C,) the corners after and before each in its face."""
    ahead = np.arange(len(faces.corners)) + 1
    ahead[faces.first + faces.counts - 1] = faces.first
    back = np.empty_like(ahead)
    back[ahead] = np.arange(len(ahead))
    return ahead, back


def _edges(cage: Cage, ahead: Codes) -> _Edges:
    a, b = cage.faces.corners, cage.faces.corners[ahead]
    count = len(cage.points)
    key, of, faces = np.unique(np.minimum(a, b) * count + np.maximum(a, b), return_inverse=True, return_counts=True)
    sharpness = np.where(faces == 2, 0.0, SHARP)
    if len(cage.edges):
        creased = cage.edges.min(axis=1) * count + cage.edges.max(axis=1)
        at = np.minimum(np.searchsorted(key, creased), len(key) - 1)
        known = key[at] == creased
        np.maximum.at(sharpness, at[known], cage.edge_sharpness[known])
    return _Edges(np.stack([key // count, key % count], axis=1), of, sharpness)


def _smoothed(cage: Cage, edges: _Edges, middle: F64, face: Codes) -> F64:
    """(P, w) where the old points come to lie if nothing is sharp."""
    points = cage.points
    count = len(points)
    ends, others = edges.ends.reshape(-1), edges.ends[:, ::-1].reshape(-1)
    n = np.maximum(np.bincount(ends, minlength=count), 1)[:, None]
    around, about = _mean(points[others], ends, count), _mean(middle[face], cage.faces.corners, count)
    return np.asarray((about + around + (n - 2.0) * points) / n)


def _points(cage: Cage, edges: _Edges, smooth: F64) -> F64:
    """(P, w) where the old points come to lie; smooth: if nothing were sharp."""
    points = cage.points
    count = len(points)
    ends, others = edges.ends.reshape(-1), edges.ends[:, ::-1].reshape(-1)
    is_sharp = np.repeat(edges.sharpness > 0, 2)
    sharp = np.bincount(ends[is_sharp], minlength=count)
    crease = (6 * points + 2 * _mean(points[others[is_sharp]], ends[is_sharp], count)) / 8
    # Of edges that cease to be sharp at this level, how much they still are: OpenSubdiv's weight between two rules.
    ceases = is_sharp & (np.repeat(edges.sharpness, 2) <= 1)
    ceasing = np.bincount(ends[ceases], minlength=count)
    least = np.bincount(ends[ceases], np.repeat(edges.sharpness, 2)[ceases], count) / np.maximum(ceasing, 1)
    least = np.where(ceasing > 0, least, np.where(sharp > 0, 1.0, 0.0))

    still = np.where(sharp > 2, np.maximum(_stillness(cage, edges, sharp), least), _stillness(cage, edges, sharp))

    share = np.clip(np.where(sharp == 2, least, 0), 0, 1)[:, None]
    found = share * crease + (1 - share) * smooth
    share = np.clip(still, 0, 1)[:, None]
    return share * points + (1 - share) * found


def _stillness(cage: Cage, edges: _Edges, sharp: Codes) -> F64:
    """(P,) the sharpness of points themselves; sharp: how many sharp edges end in each."""
    count = len(cage.points)
    still = np.zeros(count)
    np.maximum.at(still, cage.corners, cage.corner_sharpness)
    faces_at = np.bincount(cage.faces.corners, minlength=count)
    if cage.sharp_boundary_corners:
        still[(faces_at == 1) & (sharp == 2)] = SHARP
    still[faces_at == 0] = SHARP
    still[sharp > 2] = np.maximum(still[sharp > 2], 1e-9)
    return still


def _within(values: AtCorners, faces: Faces, ahead: Codes, back: Codes) -> AtCorners:
    own = values.each().astype(np.float64)
    middle = _mean(own, faces.face, len(faces.counts))[faces.face]
    onward = (own + own[ahead]) / 2
    four = np.stack([own, onward, middle, onward[back]], axis=1)
    found: F32 = four.reshape(-1, own.shape[1]).astype(np.float32)
    return AtCorners(found, np.arange(len(found)))


def _mean(values: F64, group: Codes, count: int) -> F64:
    """(count, w) the mean of the values of each group; 0 of none."""
    total = np.stack([np.bincount(group, values[:, k], count) for k in range(values.shape[1])], axis=1)
    result: F64 = total / np.maximum(np.bincount(group, minlength=count), 1)[:, None]
    return result
