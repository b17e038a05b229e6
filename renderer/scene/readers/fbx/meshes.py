"""Triangulates or subdivides FBX polygons: equal corners share a vertex, and each material gets a mesh."""

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
from renderer.scene.subdivision.meshes import refined_polygons
from renderer.scene.subdivision.polygons import AtCorners, Faces, joined, triangles_of

__all__ = ["Part", "is_subdivided", "parts_of", "subdivided_parts"]

U32 = npt.NDArray[np.uint32]

_SMOOTH = (2, 3)  # ufbx_subdivision_display_mode
_SHARPNESS = 10.0  # of an edge whose crease is 1
_MOST_LEVELS = 6


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


def is_subdivided(mesh: Any) -> bool:
    """Returns True if the file shows a mesh as a subdivision surface."""
    return mesh.subdivision_mode in _SMOOTH and mesh.subdivision_levels > 0


def subdivided_parts(mesh: Any) -> tuple[list[Part], npt.NDArray[np.float64]]:
    """Returns the parts by material of a mesh subdivided as for rendering, and the points (P, 3) to which they refer."""
    count = array(mesh.faces, np.uint32, 2).astype(np.int64)[:, 1]
    holes = array(mesh.face_hole, np.uint8)
    shown = np.flatnonzero((count >= 3) & ((holes == 0) if len(holes) == len(count) else True))
    points = array(mesh.vertices, np.float64, 3)
    if not len(shown):
        return [], points
    corners = array(mesh.vertex_indices, np.uint32).astype(np.int64)
    faces, taken = Faces(count, corners).selected(shown)
    uv_sets = each(mesh.uv_sets, layout.UvSet)
    given = {name: uv_sets[i].uv for i, name in enumerate(("uvs", "uvs1")) if i < len(uv_sets)} | {"colors": mesh.color}
    attributes = {name: values for name, vertex in given.items() if (values := _indexed(vertex, 4 if name == "colors" else 2))}
    attributes = {name: values.at_corners(taken) for name, values in attributes.items()}
    edges, crease = array(mesh.edges, np.uint32, 2).astype(np.int64), array(mesh.edge_crease, np.float64)
    creases = None
    if len(crease) == len(edges) and (crease > 0).any():
        creases = corners[edges[crease > 0]], crease[crease > 0] * _SHARPNESS
    found = refined_polygons(points, faces, attributes, min(int(mesh.subdivision_levels), _MOST_LEVELS), creases)
    slots = array(mesh.face_material, np.uint32)
    slot = slots[shown][found.old].astype(np.int64) if len(slots) == len(count) else np.zeros(len(found.old), np.int64)
    parts = []
    for number in np.unique(slot).tolist():
        some, at_corners = found.faces.masked(slot == number)
        own = {name: values.at_corners(at_corners) for name, values in found.attributes.items()}
        first, vertex = joined(some, list(own.values()))
        made = {name: np.ascontiguousarray(values.values[values.code[first]], np.float32) for name, values in own.items()}
        point = some.corners[first]
        for name in ("uvs", "uvs1"):
            if name in made:
                made[name][:, 1] = 1 - made[name][:, 1]  # FBX measures v from the lower edge
        colors = made.get("colors")
        if colors is not None and (colors == 1).all():
            colors = None
        triangles = vertex[triangles_of(some, found.points.astype(np.float32), False)].astype(np.int32)
        parts.append(Part(number, point, triangles, found.normals[point], made.get("uvs"), made.get("uvs1"), colors))
    return parts, found.points


def _indexed(vertex: Any, width: int) -> AtCorners | None:
    """Returns an attribute at the corners of a mesh's faces, with equal values shared; None if the mesh lacks it."""
    if not vertex.exists:
        return None
    values = list_view(vertex.values, np.float64, width).astype(np.float32)
    indices = list_view(vertex.indices, np.uint32).astype(np.int64)
    if not len(values):
        return None
    distinct, code = np.unique(values, axis=0, return_inverse=True)
    return AtCorners(distinct, code.reshape(-1)[indices], is_indexed=True)


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
