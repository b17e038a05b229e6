"""FBX's polygons as triangles: corners that agree in everything are one vertex, and each material has a mesh of its own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, I32
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import array, each, seen, triangulated
from renderer.scene.unique import unique_corners, used_among

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
    points = array(mesh.vertex_indices, np.uint32)
    given = [
        _at_corners(mesh.normal, 3),
        *(_at_corners(uv_sets[i].uv, 2) if i < len(uv_sets) else None for i in range(2)),
        _at_corners(mesh.color, 4),
    ]
    first, kind = unique_corners(points, int(points.max(initial=0)) + 1, [values for values in given if values is not None])
    found = []
    for number, rows in _by_slot(array(mesh.face_material, np.uint32), face):
        used, triangles = used_among(kind[corners[rows]], len(first))
        at = first[used]
        normals, uvs, uvs1, colors = (None if values is None else values[at] for values in given)
        for each_uvs in (uvs, uvs1):
            if each_uvs is not None:
                each_uvs[:, 1] = 1 - each_uvs[:, 1]  # counted from the lower edge
        if colors is not None and (colors == 1).all():
            colors = None
        found.append(Part(number, points[at].astype(np.int64), triangles.astype(np.int32), normals, uvs, uvs1, colors))
    return found


def _by_slot(slots: U32, face: npt.NDArray[np.int64]) -> Iterator[tuple[int, Any]]:
    """The slots of materials that triangles have, and which triangles; face: (T,) that each is of."""
    if not len(slots):
        yield 0, slice(None)
        return
    slot = slots[face]
    if slot.min() == slot.max():
        yield int(slot[0]), slice(None)
        return
    order = np.argsort(slot, kind="stable")
    begins = np.flatnonzero(np.diff(slot[order], prepend=np.int64(-1)))
    for begin, end in pairwise([*begins.tolist(), len(order)]):
        yield int(slot[order[begin]]), order[begin:end]


def _at_corners(vertex: Any, width: int) -> F32 | None:
    """(C, width) the values at the corners of a mesh's faces; None where it has none."""
    if not vertex.exists:
        return None
    values = seen(vertex.values, np.float64, width).astype(np.float32)
    return values[seen(vertex.indices, np.uint32)] if len(values) else None


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
