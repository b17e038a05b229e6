"""Faces of any number of corners, and the values that a mesh has at its corners, as triangles with vertices of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.readers.usd.ears import Scissors

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
    """(T, 3) numbers of corners: triangles that fill the faces, counter-clockwise unless mirrored.

    Fans, but for what is not convex: quads are cut along their other diagonal, and larger polygons ear by ear, as long as
    that takes no longer than some seconds.
    """
    counts, first = faces.counts, faces.first
    most = int(counts.max(initial=0))
    if most == 3 and len(faces.corners) == 3 * len(counts):
        fans = np.arange(len(faces.corners)).reshape(-1, 3)
        return fans[:, ::-1] if mirrored else fans
    face = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
    start = np.cumsum(np.maximum(counts - 2, 0)) - np.maximum(counts - 2, 0)
    step = np.arange(len(face)) - start[face]
    fans = np.stack([first[face], first[face] + step + 1, first[face] + step + 2], axis=1)
    for number in np.flatnonzero(counts == 4)[_bent_quads(faces, points)]:
        a = first[number]
        fans[start[number] : start[number] + 2] = (a, a + 1, a + 3), (a + 1, a + 2, a + 3)
    scissors = Scissors()
    for number in _hollow(faces, points) if most > 4 else ():
        a, n = int(first[number]), int(counts[number])
        if not scissors.are_blunt:
            fans[start[number] : start[number] + n - 2] = a + scissors.cut(points[faces.corners[a : a + n]].astype(np.float64))
    return fans[:, ::-1] if mirrored else fans


def _bent_quads(faces: Faces, points: F32) -> npt.NDArray[np.bool_]:
    """Of all quads, those whose two triangles would face each other."""
    begin = faces.first[faces.counts == 4]
    if len(begin) == 0:
        return np.zeros(0, bool)
    a, b, c, d = (points[faces.corners[begin + k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0


def _hollow(faces: Faces, points: F32) -> Codes:
    """The faces of five corners and more of which one bends inwards."""
    large = np.flatnonzero(faces.counts > 4)
    if len(large) == 0:
        return large
    some, corners = faces.kept(faces.counts > 4)
    place = points[some.corners].astype(np.float64)
    along = np.arange(len(corners)) + 1
    ends = some.first + some.counts
    along[ends - 1] = some.first
    back = np.empty_like(along)
    back[along] = np.arange(len(along))
    turn = np.cross(place[along] - place, place - place[back])
    whole = np.stack([np.bincount(some.face, turn[:, k]) for k in range(3)], axis=1)
    # The sum of all turns points to the face's outside; a corner that turns against it bends inwards.
    inwards = np.einsum("ij,ij->i", turn, whole[some.face]) < 0
    return large[np.bincount(some.face, inwards, len(some.counts)) > 0]


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
