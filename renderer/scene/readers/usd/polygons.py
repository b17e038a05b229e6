"""Faces of any number of corners, and the values that a mesh has at its corners, as triangles with vertices of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.polygons import triangulate

__all__ = ["AtCorners", "Faces", "cut", "joined"]

Codes = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Faces:
    """Polygons: `corners` are numbers of points, those of each face one behind the other."""

    counts: Codes  # (F,)
    corners: Codes  # (C,)

    @cached_property
    def first(self) -> Codes:
        """(F,) where each face's corners begin."""
        return np.cumsum(self.counts) - self.counts

    @property
    def face(self) -> Codes:
        """(C,) the face of each corner."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def kept(self, which: npt.NDArray[np.bool_]) -> tuple[Faces, Codes]:
        """Some of the faces, and the numbers of their corners among all."""
        return self.those(np.flatnonzero(which))

    def those(self, numbers: Codes) -> tuple[Faces, Codes]:
        """The same by their numbers, in time that grows with these alone."""
        counts = self.counts[numbers]
        step = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
        corners = np.repeat(self.first[numbers], counts) + step
        return Faces(counts, self.corners[corners]), corners


@dataclass(frozen=True)
class AtCorners:
    """Values (K, w), and which of them each corner has."""

    values: F32
    code: Codes  # (C,)
    by_point: bool = False  # whether corners at one point always have the same
    kinds: F32 | None = None  # (K, w) what tells them apart, where that must not depend on the time
    is_indexed: bool = False  # whether corners that share a value say so

    def at(self, corners: Codes) -> AtCorners:
        """The same for some of the corners."""
        return replace(self, code=self.code[corners])

    def each(self) -> F32:
        """(C, w) the value of each corner."""
        return self.values[self.code]


def cut(faces: Faces, points: F32, mirrored: bool) -> npt.NDArray[np.int64]:
    """(T, 3) numbers of corners: triangles that fill the faces, counter-clockwise unless mirrored."""
    cuts = triangulate(faces.counts, faces.corners, points).triangles
    return cuts[:, ::-1] if mirrored else cuts


def joined(faces: Faces, attributes: list[AtCorners]) -> tuple[Codes, I32]:
    """(one corner of each vertex, the vertex of each corner): corners that agree in point and values are one vertex."""
    # By 64 bits of a hash: that two of three million differ and collide has the odds of 2e-7.
    key = _mixed(faces.corners.astype(np.uint64), np.zeros(len(faces.corners), np.uint64))
    for attribute in attributes:
        if not attribute.by_point:
            values, code = attribute.values if attribute.kinds is None else attribute.kinds, attribute.code
            key = _mixed(key, _hashed(values)[code] if len(values) <= len(code) else _hashed(values[code]))
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    return first, vertex.astype(np.int32)


def _hashed(values: F32) -> npt.NDArray[np.uint64]:
    """(K,) a hash of each value."""
    words = np.ascontiguousarray(values + np.float32(0)).view(np.uint32)  # + 0: there are two zeros
    found = np.zeros(len(values), np.uint64)
    for column in words.T:
        found = _mixed(found, column.astype(np.uint64))
    return found


def _mixed(one: npt.NDArray[np.uint64], other: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    # The finalizer of SplitMix64 (Steele, Lea & Flood 2014), so that each bit of either has a part in all.
    key = (one * np.uint64(0x9E3779B97F4A7C15)) ^ other
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))
