"""FBX's polygons as triangles: corners that agree in everything are one vertex, and each material has a mesh of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import array, each, triangulated
from renderer.scene.unique import unique_rows

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
    slots = array(mesh.face_material, np.uint32)
    slot = slots[face] if len(slots) else np.zeros(len(face), np.uint32)
    found = []
    for number in np.unique(slot):
        used = corners[slot == number].reshape(-1)
        present = [a for a in attributes if a.exists]
        table = np.column_stack([points[used], *(a.indices[used] for a in present)]).astype(np.int64)
        first, kind = unique_rows(table)
        at = used[first]
        normals, uvs, uvs1, colors = (a.values[a.indices[at]].astype(np.float32) if a.exists else None for a in attributes)
        for each_uvs in (uvs, uvs1):
            if each_uvs is not None:
                each_uvs[:, 1] = 1 - each_uvs[:, 1]  # counted from the lower edge
        if colors is not None and (colors == 1).all():
            colors = None
        triangles = kind.reshape(-1, 3).astype(np.int32)
        found.append(Part(int(number), points[at].astype(np.int64), triangles, normals, uvs, uvs1, colors))
    return found


class _Attribute:
    """Values at the corners of a mesh's faces."""

    def __init__(self, vertex: Any, width: int) -> None:
        self.exists = vertex is not None and bool(vertex.exists)
        if self.exists:
            self.values = array(vertex.values, np.float64, width)
            self.indices = array(vertex.indices, np.uint32)
            self.exists = len(self.values) > 0


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
    order = np.argsort(np.concatenate(of), kind="stable")
    return np.concatenate(corners)[order], np.concatenate(of)[order]


def _halved(corners: npt.NDArray[np.int64], mesh: Any) -> npt.NDArray[np.int64]:
    """(2 Q, 3) corners of (Q, 4): cut from the first to the third, but where that lies outside of the face."""
    points = array(mesh.vertices, np.float64, 3)[array(mesh.vertex_indices, np.uint32)[corners]]
    a, b, c, d = (points[:, k] for k in range(4))
    inside = np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) >= 0
    straight = corners[:, [0, 1, 2, 0, 2, 3]]
    other = corners[:, [0, 1, 3, 1, 2, 3]]
    return np.where(inside[:, None], straight, other).reshape(-1, 3)
