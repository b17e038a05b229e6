"""Triangulates FBX polygons: equal corners share a vertex, and each material gets a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.deduplicate import unique_corners, used_among
from renderer.scene.description import F32, I32
from renderer.scene.polygons import triangulate
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import array, each, list_view

__all__ = ["Part", "parts_of"]

U32 = npt.NDArray[np.uint32]


class Part(NamedTuple):
    """The part of a mesh that has one material: its vertices, and for each vertex the index of the file's point there."""

    slot: int  # index among the node's materials
    point: npt.NDArray[np.int64]  # (V,)
    triangles: I32  # (T, 3)
    normals: F32 | None
    uvs: F32 | None
    uvs1: F32 | None
    colors: F32 | None


def parts_of(mesh: Any) -> tuple[list[Part], int]:
    """Returns the parts of a mesh by material, and the number of concave faces that could not be triangulated.

    Holes and faces of fewer than three corners are left out.
    """
    corners, face, unfilled = _triangles(mesh)
    if not len(corners):
        return [], 0
    uv_sets = each(mesh.uv_sets, layout.UvSet)
    points = array(mesh.vertex_indices, np.uint32)
    given = [
        _at_corners(mesh.normal, 3),
        *(_at_corners(uv_sets[i].uv, 2) if i < len(uv_sets) else None for i in range(2)),
        _at_corners(mesh.color, 4),
    ]
    first, kind = unique_corners(points, int(points.max(initial=0)) + 1, [values for values in given if values is not None])
    found = []
    for number, rows in _triangles_by_slot(array(mesh.face_material, np.uint32), face):
        used, triangles = used_among(kind[corners[rows]], len(first))
        at = first[used]
        normals, uvs, uvs1, colors = (None if values is None else values[at] for values in given)
        for each_uvs in (uvs, uvs1):
            if each_uvs is not None:
                each_uvs[:, 1] = 1 - each_uvs[:, 1]  # FBX measures v from the lower edge
        if colors is not None and (colors == 1).all():
            colors = None
        found.append(Part(number, points[at].astype(np.int64), triangles.astype(np.int32), normals, uvs, uvs1, colors))
    return found, unfilled


def _triangles_by_slot(slots: U32, face: npt.NDArray[np.int64]) -> Iterator[tuple[int, Any]]:
    """Yields each material slot in use, with the indices (or a slice) of the triangles that have the slot's material.

    face: (T,) index of the polygon that each triangle belongs to.
    """
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
    """Returns the (C, width) values of an attribute at the corners of a mesh's faces; None if the mesh lacks it."""
    if not vertex.exists:
        return None
    values = list_view(vertex.values, np.float64, width).astype(np.float32)
    return values[list_view(vertex.indices, np.uint32)] if len(values) else None


def _triangles(mesh: Any) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], int]:
    """Triangulates the visible faces of a mesh.

    Returns (T, 3) corner indices, (T,) the face of each triangle, and the number of concave faces that could not be triangulated.
    """
    faces = array(mesh.faces, np.uint32, 2).astype(np.int64)
    holes = array(mesh.face_hole, np.uint8)
    shown = np.flatnonzero(holes == 0) if len(holes) == len(faces) else np.arange(len(faces))
    begin, count = faces[shown].T if len(faces) else np.zeros((2, 0), np.int64)
    corner = np.repeat(begin - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))
    points = array(mesh.vertices, np.float64, 3)
    cut = triangulate(count, array(mesh.vertex_indices, np.uint32)[corner], points)
    return corner[cut.triangles], shown[cut.face], cut.unfilled
