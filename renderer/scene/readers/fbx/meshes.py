"""FBX's polygons as triangles: corners that agree in everything are one vertex, and each material has a mesh of its own."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import array, each, triangulated
from renderer.scene.unique import unique_rows, unique_threes

__all__ = ["Part", "parts_of"]

U32 = npt.NDArray[np.uint32]
F64 = npt.NDArray[np.float64]


class Part(NamedTuple):
    """What of a mesh has one material: the description's vertices, and which points of the file's they are at."""

    slot: int  # among the materials of the node
    point: npt.NDArray[np.int64]  # (V,)
    triangles: I32  # (T, 3)
    normals: F32 | None
    uvs: F32 | None
    uvs1: F32 | None
    colors: F32 | None


def parts_of(mesh: Any) -> list[Part]:
    """The parts of a mesh with faces, by their materials. Holes, and faces of fewer than three corners, are left out."""
    corners, face = _triangles(mesh)
    if not len(corners):
        return []
    uv_sets = each(mesh.uv_sets, layout.UvSet)
    attributes = [
        _Attribute(mesh.normal, 3),
        *(_Attribute(uv_sets[i].uv if i < len(uv_sets) else None, 2) for i in range(2)),
        _Attribute(mesh.color, 4),
    ]
    points = array(mesh.vertex_indices, np.uint32)
    present = [a for a in attributes if a.exists]
    first, kind = _kinds([points, *(a.indices for a in present)])
    slots = array(mesh.face_material, np.uint32)
    slot = slots[face] if len(slots) else np.zeros(len(face), np.uint32)
    numbers = np.unique(slot)
    found = []
    for number in numbers:
        vertices = kind[corners if len(numbers) == 1 else corners[slot == number]].reshape(-1)
        used = np.zeros(len(first), bool)
        used[vertices] = True
        place = np.cumsum(used) - 1
        at = first[used]
        normals, uvs, uvs1, colors = (a.values[a.indices[at]].astype(np.float32) if a.exists else None for a in attributes)
        for each_uvs in (uvs, uvs1):
            if each_uvs is not None:
                each_uvs[:, 1] = 1 - each_uvs[:, 1]  # counted from the lower edge
        if colors is not None and (colors == 1).all():
            colors = None
        triangles = place[vertices].reshape(-1, 3).astype(np.int32)
        found.append(Part(int(number), points[at].astype(np.int64), triangles, normals, uvs, uvs1, colors))
    return found


def _kinds(columns: list[U32]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Of corners, by what they are made of: the first of each kind, and the kind of each. As `unique_rows`, by a number each."""
    sizes = [int(column.max(initial=0)) + 1 for column in columns]
    if math.prod(sizes) >= 1 << 63:
        return unique_rows(np.column_stack(columns).astype(np.int64))
    key = np.zeros(len(columns[0]), np.int64)
    for column, size in zip(columns, sizes, strict=True):
        key = key * size + column
    _, first, kind = np.unique(key, return_index=True, return_inverse=True)
    return first, kind


class _Attribute:
    """Values at the corners of a mesh's faces."""

    def __init__(self, vertex: Any, width: int) -> None:
        self.exists = vertex is not None and bool(vertex.exists)
        if self.exists:
            self.values = array(vertex.values, np.float64, width)
            self.indices = array(vertex.indices, np.uint32)
            self.exists = len(self.values) > 0
            if self.exists and len(self.values) == len(self.indices) and width < 4:
                self._join(width)

    def _join(self, width: int) -> None:
        """Where each corner has a value of its own, as most programs write normals, those that are the same become one."""
        padded = np.zeros((len(self.indices), 3), np.float32)
        padded[:, :width] = self.values[self.indices]
        first, kind = unique_threes(padded + np.float32(0))  # there are two zeros
        self.values, self.indices = self.values[self.indices[first]], kind.astype(np.uint32)


def _triangles(mesh: Any) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """(T, 3) corners, and (T,) the face that each is of."""
    faces = array(mesh.faces, np.uint32, 2).astype(np.int64)
    holes = array(mesh.face_hole, np.uint8)
    shown = holes == 0 if len(holes) == len(faces) else np.ones(len(faces), bool)
    begin, count = faces.T if len(faces) else np.zeros((2, 0), np.int64)
    corners, of = [], []
    three = np.flatnonzero((count == 3) & shown)
    corners.append(begin[three, None] + np.arange(3))
    of.append(three)
    four = np.flatnonzero((count == 4) & shown)
    corners.append(_halved(begin[four, None] + np.arange(4), mesh))
    of.append(np.repeat(four, 2))
    for number in np.flatnonzero((count > 4) & shown):
        cut = triangulated(mesh, int(begin[number]), int(count[number]))
        corners.append(cut.astype(np.int64))
        of.append(np.full(len(cut), number))
    cuts, numbers = np.concatenate(corners), np.concatenate(of)
    if len(three) == len(numbers) or 2 * len(four) == len(numbers):
        return cuts, numbers
    order = np.argsort(numbers, kind="stable")
    return cuts[order], numbers[order]


def _halved(corners: npt.NDArray[np.int64], mesh: Any) -> npt.NDArray[np.int64]:
    """(2 Q, 3) corners of (Q, 4): cut from the first to the third, but where that lies outside of the face."""
    points = array(mesh.vertices, np.float64, 3)
    a, b, c, d = (points[array(mesh.vertex_indices, np.uint32)[corners[:, k]]] for k in range(4))
    (x, y, z), (u, v, w) = _cross(b - a, c - a), _cross(c - a, d - a)
    inside = x * u + y * v + z * w >= 0
    straight = corners[:, [0, 1, 2, 0, 2, 3]]
    if inside.all():
        return straight.reshape(-1, 3)
    return np.where(inside[:, None], straight, corners[:, [0, 1, 3, 1, 2, 3]]).reshape(-1, 3)


def _cross(a: F64, b: F64) -> tuple[F64, F64, F64]:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
