"""Polygons with values at their corners, and their conversion to triangles and vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.polygons import triangulate

__all__ = ["AtCorners", "Faces", "joined", "triangles_of"]

Codes = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Faces:
    """Polygons, as the number of corners of each face and the point indices of all corners, concatenated."""

    counts: Codes  # (F,)
    corners: Codes  # (C,)

    @cached_property
    def first_corners(self) -> Codes:
        """Returns (F,) the index of each face's first corner."""
        return np.cumsum(self.counts) - self.counts

    @property
    def face(self) -> Codes:
        """Returns (C,) the face of each corner."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def masked(self, mask: npt.NDArray[np.bool_]) -> tuple[Faces, Codes]:
        """Returns the faces selected by a mask (F,), and the indices of their corners among the corners of all faces."""
        return self.selected(np.flatnonzero(mask))

    def selected(self, numbers: Codes) -> tuple[Faces, Codes]:
        """Returns the faces with these indices, and the indices of their corners among the corners of all faces.

        Takes time proportional to the number of selected faces.
        """
        counts = self.counts[numbers]
        step = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
        corners = np.repeat(self.first_corners[numbers], counts) + step
        return Faces(counts, self.corners[corners]), corners


@dataclass(frozen=True)
class AtCorners:
    """Per-corner values of a mesh: (K, w) distinct values, and (C,) the index of each corner's value."""

    values: F32
    code: Codes  # (C,)
    by_point: bool = False  # whether all corners of a point share a value
    kinds: F32 | None = None  # (K, w) values that distinguish vertices, independent of time
    is_indexed: bool = False  # whether shared values are indexed

    def at_corners(self, corners: Codes) -> AtCorners:
        """Returns the per-corner values of some of the corners. corners: their indices."""
        return replace(self, code=self.code[corners])

    def corner_values(self) -> F32:
        """Returns (C, w) the value at each corner."""
        return self.values[self.code]


def triangles_of(faces: Faces, points: F32, mirrored: bool) -> npt.NDArray[np.int64]:
    """Returns (T, 3) corner indices of triangles that cover the faces; counter-clockwise, or clockwise if mirrored."""
    cuts = triangulate(faces.counts, faces.corners, points).triangles
    return cuts[:, ::-1] if mirrored else cuts


def joined(faces: Faces, attributes: list[AtCorners]) -> tuple[Codes, I32]:
    """Merges corners with equal point and values into vertices.

    Returns (V,) the index of one corner of each vertex, and (C,) the vertex of each corner.
    """
    # By 64-bit hashes: the probability of a collision among three million is 2e-7.
    key = _hash_pair(faces.corners.astype(np.uint64), np.zeros(len(faces.corners), np.uint64))
    for attribute in attributes:
        if not attribute.by_point:
            values, code = attribute.values if attribute.kinds is None else attribute.kinds, attribute.code
            key = _hash_pair(key, _hashed(values)[code] if len(values) <= len(code) else _hashed(values[code]))
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    return first, vertex.astype(np.int32)


def _hashed(values: F32) -> npt.NDArray[np.uint64]:
    """Returns (K,) 64-bit hashes of the values."""
    words = np.ascontiguousarray(values + np.float32(0)).view(np.uint32)  # + 0 turns -0 into 0
    found = np.zeros(len(values), np.uint64)
    for column in words.T:
        found = _hash_pair(found, column.astype(np.uint64))
    return found


def _hash_pair(one: npt.NDArray[np.uint64], other: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    # The finalizer of SplitMix64 (Steele, Lea & Flood 2014) of the combined bits.
    key = (one * np.uint64(0x9E3779B97F4A7C15)) ^ other
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))
