"""Catmull-Clark and Loop subdivision surfaces with semi-sharp creases.

Sources: Catmull & Clark 1978; for the creases, DeRose, Kass & Truong 1998, "Subdivision Surfaces in Character Animation".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32
from renderer.scene.subdivision import loop
from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces

__all__ = ["Cage", "limit", "refined"]

F64 = npt.NDArray[np.float64]
MAX_FURTHER, MAX_CORNERS = 4, 8_000_000
SMOOTH_TRIANGLE = 0.470  # OpenSubdiv's weight; 1/4 otherwise
SHARP = 10.0  # OpenSubdiv's maximum: sharp at every level


@dataclass(frozen=True)
class Cage:
    """The control mesh of a subdivision surface.

    points: (P, w) positions and, in further columns, other per-point values; all columns are smoothed alike.
    """

    points: F64
    faces: Faces
    edges: Codes  # (E, 2) points of creased edges
    edge_sharpness: F64  # (E,)
    corners: Codes  # sharp points
    corner_sharpness: F64
    sharp_boundary_corners: bool = True  # whether boundary points of a single face are fixed
    is_loop: bool = False  # triangles, subdivided by Loop's rules
    has_smooth_triangles: bool = False  # Catmull-Clark's smooth triangle rule


class _Edges(NamedTuple):
    ends: Codes  # (E, 2)
    of: Codes  # (C,) the edge from each corner to the next
    sharpness: F64  # (E,)


def refined(cage: Cage, along: list[AtCorners]) -> tuple[Cage, list[AtCorners], Codes]:
    """Subdivides a cage once, together with per-corner values, which are interpolated linearly within their face.

    along: the per-corner values; per-point values are columns of the cage's points. Returns the new cage, the per-corner values
    for it, and the original face of each of its faces.
    """
    faces, points = cage.faces, cage.points
    ahead, back = _neighbours(faces)
    edges = _edges(cage, ahead)
    count, face = len(points), faces.face
    onto = points[edges.ends].mean(axis=1)
    if cage.is_loop:
        smooth = loop.on_edges(points, edges.ends, edges.of, faces.corners[back])
        old, new_points = loop.smoothed(points, edges.ends), np.zeros((0, points.shape[1]))
        finer_faces, parent = loop.split_triangles(faces.corners, count + edges.of)
        within = loop.interpolate
    else:
        middle = _group_means(points[faces.corners], face, len(faces.counts))
        beside = np.where(cage.has_smooth_triangles & (faces.counts[face] == 3), SMOOTH_TRIANGLE, 0.25)[:, None]
        share = 2 * _group_means(beside, edges.of, len(edges.ends))
        smooth = (1 - share) * onto + share * _group_means(middle[face], edges.of, len(edges.ends))
        old, new_points = _smoothed(cage, edges, middle, face), middle
        # Each corner becomes a quad: the corner, the next edge point, the face point and the previous edge point.
        quads = np.stack([faces.corners, count + edges.of, count + len(edges.ends) + face, count + edges.of[back]], axis=1)
        finer_faces, parent = Faces(np.full(len(quads), 4), quads.reshape(-1)), face
        within = _interpolate
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
    """Returns (P, w) the limit positions of a cage's points.

    Cages with semi-sharp creases are first subdivided until these are smooth, within MAX_FURTHER levels and MAX_CORNERS corners.
    """
    count, level = len(cage.points), 0
    while level < MAX_FURTHER and 4 * len(cage.faces.corners) <= MAX_CORNERS and _is_half_sharp(cage):
        cage, level = refined(cage, [])[0], level + 1
    return _limit(cage)[:count]


def _is_half_sharp(cage: Cage) -> bool:
    return any(bool(((sharp > 0) & (sharp < SHARP)).any()) for sharp in (cage.edge_sharpness, cage.corner_sharpness))


def _limit(cage: Cage) -> F64:
    """Returns (P, w) the limit positions of a cage of quads, or of triangles for Loop.

    Creases converge to cubic B-splines. Source: Halstead, Kass & DeRose 1993.
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
        around, across = _group_means(points[others], ends, count), _group_means(points[opposite], faces.corners, count)
        smooth = (n * points + 4 * around + across) / (n + 5)
    is_sharp = np.repeat(edges.sharpness > 0, 2)
    sharp = np.bincount(ends[is_sharp], minlength=count)[:, None]
    crease = (4 * points + 2 * _group_means(points[others[is_sharp]], ends[is_sharp], count)) / 6
    still = _point_sharpness(cage, edges, sharp[:, 0])[:, None]
    return np.where((still > 0) | (n == 0), points, np.where(sharp == 2, crease, smooth))


def _neighbours(faces: Faces) -> tuple[Codes, Codes]:
    """Returns (C,) the index of the next corner in the face of each corner, and (C,) that of the previous one."""
    ahead = np.arange(len(faces.corners)) + 1
    ahead[faces.first_corners + faces.counts - 1] = faces.first_corners
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
    """Returns (P, w) the new positions of the cage's points by the Catmull-Clark rule for smooth points.

    middle: (F, w) the faces' centres; face: (C,) the face of each corner.
    """
    points = cage.points
    count = len(points)
    ends, others = edges.ends.reshape(-1), edges.ends[:, ::-1].reshape(-1)
    n = np.maximum(np.bincount(ends, minlength=count), 1)[:, None]
    around, about = _group_means(points[others], ends, count), _group_means(middle[face], cage.faces.corners, count)
    return np.asarray((about + around + (n - 2.0) * points) / n)


def _points(cage: Cage, edges: _Edges, smooth: F64) -> F64:
    """Returns (P, w) the new positions of the cage's points, with sharp creases and corners taken into account.

    smooth: (P, w) their positions by the rule for smooth points.
    """
    points = cage.points
    count = len(points)
    ends, others = edges.ends.reshape(-1), edges.ends[:, ::-1].reshape(-1)
    is_sharp = np.repeat(edges.sharpness > 0, 2)
    sharp = np.bincount(ends[is_sharp], minlength=count)
    crease = (6 * points + 2 * _group_means(points[others[is_sharp]], ends[is_sharp], count)) / 8
    # Fractional sharpness of edges that become smooth at this level: OpenSubdiv's weight between two rules.
    ceases = is_sharp & (np.repeat(edges.sharpness, 2) <= 1)
    ceasing = np.bincount(ends[ceases], minlength=count)
    least = np.bincount(ends[ceases], np.repeat(edges.sharpness, 2)[ceases], count) / np.maximum(ceasing, 1)
    least = np.where(ceasing > 0, least, np.where(sharp > 0, 1.0, 0.0))

    still = np.where(sharp > 2, np.maximum(_point_sharpness(cage, edges, sharp), least), _point_sharpness(cage, edges, sharp))

    share = np.clip(np.where(sharp == 2, least, 0), 0, 1)[:, None]
    found = share * crease + (1 - share) * smooth
    share = np.clip(still, 0, 1)[:, None]
    return share * points + (1 - share) * found


def _point_sharpness(cage: Cage, edges: _Edges, sharp: Codes) -> F64:
    """Returns (P,) the corner sharpness of each of the cage's points; 0 for points that are not corners.

    sharp: (P,) number of sharp edges at each point.
    """
    count = len(cage.points)
    still = np.zeros(count)
    np.maximum.at(still, cage.corners, cage.corner_sharpness)
    faces_at = np.bincount(cage.faces.corners, minlength=count)
    if cage.sharp_boundary_corners:
        still[(faces_at == 1) & (sharp == 2)] = SHARP
    still[faces_at == 0] = SHARP
    still[sharp > 2] = np.maximum(still[sharp > 2], 1e-9)
    return still


def _interpolate(values: AtCorners, faces: Faces, ahead: Codes, back: Codes) -> AtCorners:
    own = values.corner_values().astype(np.float64)
    middle = _group_means(own, faces.face, len(faces.counts))[faces.face]
    onward = (own + own[ahead]) / 2
    four = np.stack([own, onward, middle, onward[back]], axis=1)
    found: F32 = four.reshape(-1, own.shape[1]).astype(np.float32)
    return AtCorners(found, np.arange(len(found)))


def _group_means(values: F64, group: Codes, count: int) -> F64:
    """Returns (count, w) the mean of the values in each group; 0 for empty groups. group: (N,) group index of each value."""
    total = np.stack([np.bincount(group, values[:, k], count) for k in range(values.shape[1])], axis=1)
    result: F64 = total / np.maximum(np.bincount(group, minlength=count), 1)[:, None]
    return result
