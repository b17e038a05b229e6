"""Subdivides polygons of any file format, and triangle meshes whose quads are found again."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import F32, Mesh
from renderer.scene.subdivision.catmull_clark import Cage
from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces, joined, triangles_of
from renderer.scene.subdivision.refine import subdivide

__all__ = ["Refined", "quads_of", "refined_polygons", "subdivided"]

F64 = npt.NDArray[np.float64]

_FACE_VARYING = "cornersPlus1"  # USD's default
_FLAT = 0.5  # least cosine between the normals of two triangles that are taken for a quad


class Refined(NamedTuple):
    """Subdivided polygons: their points and smooth normals, values at their corners, and the original face of each."""

    points: F64  # (P, 3)
    normals: F32  # (P, 3), unit
    faces: Faces
    attributes: dict[str, AtCorners]
    old: Codes  # (F,)


def refined_polygons(
    points: F64,
    faces: Faces,
    attributes: dict[str, AtCorners],
    levels: int,
    creases: tuple[Codes, F64] | None = None,
    is_loop: bool = False,
) -> Refined:
    """Subdivides polygons of three corners or more after Catmull and Clark, or triangles after Loop.

    creases: end points (E, 2) of sharp edges, and their sharpness (E,): how many levels they stay sharp.
    """
    none = np.zeros(0, np.int64)
    edges, sharpness = (np.zeros((0, 2), np.int64), np.zeros(0)) if creases is None else creases
    cage = Cage(points, faces, edges, sharpness, none, np.zeros(0), is_loop=is_loop)
    fine, finer, along, old = subdivide(cage, attributes, _FACE_VARYING, levels)
    cuts = triangles_of(finer, fine.astype(np.float32), False)
    corner = finer.corners[cuts]
    a, b, c = (fine[corner[:, k]] for k in range(3))
    u, v = b - a, c - a
    normal = np.zeros_like(fine)
    for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        face = u[:, i] * v[:, j] - u[:, j] * v[:, i]
        for k in range(3):
            normal[:, axis] += np.bincount(corner[:, k], face, len(fine))
    x, y, z = normal.T
    length = np.sqrt(x * x + y * y + z * z)
    normals = (normal / np.where(length > 0, length, 1.0)[:, None]).astype(np.float32)
    return Refined(fine, normals, finer, along, old)


def subdivided(mesh: Mesh, levels: int, faces: Faces | None = None) -> Mesh:
    """Returns a mesh subdivided `levels` times, with smooth normals. Vertices of one position are one point of the cage.

    faces: the polygons, of vertices of the mesh. Without them, pairs of triangles are taken for quads where all of them are such
    pairs; other meshes are subdivided after Loop. Fibres of hair stay as they are. Not for meshes with motion keys.
    """
    if levels == 0 or not len(mesh.triangles) or mesh.diameters is not None:
        return mesh
    if faces is None:
        faces = quads_of(mesh)
    is_loop = faces is None
    if faces is None:
        faces = Faces(np.full(len(mesh.triangles), 3), mesh.triangles.reshape(-1).astype(np.int64))
    relative = (mesh.positions - mesh.positions[0]).astype(np.float32) + np.float32(0)  # turns -0 into 0
    first, point = unique_threes(relative)
    cage_faces = Faces(faces.counts, point[faces.corners].astype(np.int64))
    attributes = {}
    for name in ("uvs", "uvs1", "colors"):
        values: F32 | None = getattr(mesh, name)
        if values is not None:
            distinct, code = np.unique(values, axis=0, return_inverse=True)
            attributes[name] = AtCorners(distinct, code.reshape(-1)[faces.corners], is_indexed=True)
    found = refined_polygons(mesh.positions[first].astype(np.float64), cage_faces, attributes, levels, is_loop=is_loop)
    corner, vertex = joined(found.faces, list(found.attributes.values()))
    at = found.faces.corners[corner]
    made = {name: np.ascontiguousarray(values.values[values.code[corner]]) for name, values in found.attributes.items()}
    points = found.points.astype(mesh.positions.dtype)
    triangles = triangles_of(found.faces, points.astype(np.float32), False)
    fine = replace(
        mesh,
        positions=np.ascontiguousarray(points[at]),
        triangles=np.ascontiguousarray(vertex[triangles].astype(np.int32)),
        normals=np.ascontiguousarray(found.normals[at]),
        tangents=None,
        keys=(),
    )
    fine.uvs, fine.uvs1, fine.colors = (made.get(name) for name in ("uvs", "uvs1", "colors"))
    return fine


def quads_of(mesh: Mesh) -> Faces | None:
    """Returns the quads of which a mesh's triangles are the halves, in order; None unless all of them are.

    Readers divide a quad into two triangles that follow each other and share a diagonal.
    """
    if len(mesh.triangles) % 2:
        return None
    first, second = mesh.triangles[0::2].astype(np.int64), mesh.triangles[1::2].astype(np.int64)
    shared = np.zeros(len(first), bool)
    quads = np.zeros((len(first), 4), np.int64)
    for i in range(3):
        for j in range(3):
            # The diagonal goes from corner i to i + 1 of the first triangle, and back in the second.
            fits = (first[:, i] == second[:, (j + 1) % 3]) & (first[:, (i + 1) % 3] == second[:, j]) & ~shared
            order = [first[:, i], second[:, (j + 2) % 3], first[:, (i + 1) % 3], first[:, (i + 2) % 3]]
            quads[fits] = np.stack(order, axis=1)[fits]
            shared |= fits
    if not shared.all():
        return None
    normals = []
    for three in (first, second):
        a, b, c = (mesh.positions[three[:, k]].astype(np.float64) for k in range(3))
        cross = np.cross(b - a, c - a)
        normals.append(cross / np.maximum(np.sqrt((cross * cross).sum(axis=1)), 1e-300)[:, None])
    if ((normals[0] * normals[1]).sum(axis=1) < _FLAT).any():
        return None
    return Faces(np.full(len(quads), 4), quads.reshape(-1))
