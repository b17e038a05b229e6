"""Reads USD meshes: triangulation or subdivision, primvars per vertex, and one mesh per material."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from renderer.errors import SceneError
from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import F32, Mesh
from renderer.scene.normals import face_normals, smoothed_together
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.refining import refine
from renderer.scene.subdivision.polygons import AtCorners, Codes, Faces, joined, triangles_of
from renderer.scene.subdivision.refine import boundary_faces
from renderer.sentences import Sentence

__all__ = ["UsedPrimvars", "area_of", "deforms", "read_mesh"]

MAX_VERTICES = 1 << 26
REFINED = ("catmullClark", "loop")


class UsedPrimvars(NamedTuple):
    """The primvars that the material of one part of a mesh uses, for UVs, colour and opacity."""

    uvs: tuple[str, ...] = ()  # primvars of the first and second UV sets
    color: str | None = None  # the primvar that multiplies the base colour
    opacity: str | None = None


class Shape(NamedTuple):
    """Points and normals of a deformed mesh, which replace those in the file."""

    points: npt.NDArray[Any]
    normals: F32 | None
    straight: F32 | None = None  # the undeformed normals


def deforms(prim: Any) -> bool:
    """Returns True if a mesh's points, faces, normals or primvars are animated."""
    mesh = UsdGeom.Mesh(prim)
    attributes = (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr(), mesh.GetNormalsAttr())
    if any(attribute.ValueMightBeTimeVarying() for attribute in attributes):
        return True
    return any(primvar.ValueMightBeTimeVarying() for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues())


def area_of(prim: Any, place: npt.NDArray[np.float64], time: Any) -> float:
    """Returns the area of a mesh after transformation by a (4, 4) matrix; 0 if its faces are damaged."""
    mesh = UsdGeom.Mesh(prim)
    points = primvars.array(mesh.GetPointsAttr().Get(time), 3)
    counts, corners = (primvars.integers(a.Get(time)) for a in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()))
    if not _is_whole(points, counts, corners):
        return 0.0
    faces, _ = Faces(counts, corners).masked(counts >= 3)
    placed = (points @ place[:3, :3].T).astype(np.float32)
    return (
        float(
            np.linalg.norm(face_normals(placed, faces.corners[triangles_of(faces, placed, False)].astype(np.int32)), axis=1).sum()
        )
        / 2
    )


def read_mesh(
    prim: Any,
    parts: list[UsedPrimvars],
    part_of_face: Codes | None,
    time: Any,
    notes: Notes,
    shape: Shape | None = None,
    bends: bool = True,
) -> list[Mesh | None]:
    """Returns the parts of a mesh, one per material; None for parts without triangles.

    parts: the primvars that each part needs. part_of_face: (F,) part index of each face; None if there is one part. shape: points
    and normals that replace the mesh's; None: the mesh's own. bends: whether the mesh may deform over time. Raises SceneError if
    the mesh is too large.
    """
    mesh = UsdGeom.Mesh(prim)
    points = primvars.array(mesh.GetPointsAttr().Get(time), 3) if shape is None else shape.points
    counts = primvars.integers(mesh.GetFaceVertexCountsAttr().Get(time))
    corners = primvars.integers(mesh.GetFaceVertexIndicesAttr().Get(time))
    if not _is_whole(points, counts, corners):
        notes.add(Sentence("usd-mesh-faces-damaged", "Meshes with damaged faces are left out"), str(prim.GetPath()))
        return [None for _ in parts]
    if len(corners) > MAX_VERTICES:
        raise SceneError(
            Sentence(
                "usd-mesh-corners-too-many",
                "{prim}: its faces have more than {most} corners; split it",
                prim=prim.GetPath(),
                most=MAX_VERTICES,
            )
        )
    faces = Faces(counts, corners)
    names = dict.fromkeys(name for part in parts for name in (*part.uvs, part.color, part.opacity) if name is not None)
    found = {name: _primvar(prim, name, faces, len(points), time, notes) for name in names}
    scheme = _scheme(mesh, counts)
    if scheme in REFINED and not np.isfinite(points).all():  # subdividing would spread them to all faces
        notes.add(
            Sentence("usd-mesh-not-refined", "Meshes with positions that are not finite are not subdivided"), str(prim.GetPath())
        )
        scheme = str(UsdGeom.Tokens.none)
    normals = _normals(mesh, scheme, faces, len(points), time, notes, shape)
    attributes = {name: values for name, values in {**found, "": normals}.items() if values is not None}
    bends = bends and deforms(prim)
    if shape is None and bends:  # the same corners must share a vertex at all times
        counted = ((name, np.arange(len(values.values), dtype=np.float32)[:, None]) for name, values in attributes.items())
        attributes |= {name: replace(attributes[name], kinds=kinds) for name, kinds in list(counted)}

    solid = counts >= 3
    if thin := int((~solid).sum()):
        notes.add(
            Sentence("usd-mesh-faces-degenerate", "{count} faces with fewer than three corners are left out", count=thin),
            str(prim.GetPath()),
        )
    holes = np.asarray(mesh.GetHoleIndicesAttr().Get(time) or (), np.int64)
    solid[holes[(holes >= 0) & (holes < len(solid))]] = False
    is_refined = scheme in REFINED
    if is_refined:
        if mesh.GetInterpolateBoundaryAttr().Get(time) == "none":
            solid &= ~boundary_faces(faces)
        points, faces, attributes, parent = refine(mesh, points, faces, attributes, time)
        part_of_face, solid = None if part_of_face is None else part_of_face[parent], solid[parent]
    mirrored = mesh.GetOrientationAttr().Get(time) == "leftHanded"
    name = prim.GetName()
    whole: list[Mesh | None] = []
    for part, which in zip(parts, _faces_by_part(np.flatnonzero(solid), part_of_face, len(parts)), strict=True):
        whole.append(_mesh_part(name, points, faces, which, attributes, part, mirrored))
    if is_refined:
        return _with_matching_normals(whole, bool(mesh.GetCreaseIndicesAttr().Get(time)), bends or shape is not None)
    return whole


def _faces_by_part(faces: Codes, part_of_face: Codes | None, parts: int) -> list[Codes]:
    """Returns, for each part, the ascending indices of those `faces` that belong to it.

    part_of_face: (F,) the part of each face of the mesh; None if there is one part. parts: number of parts.
    """
    if part_of_face is None:
        return [faces]
    order = np.argsort(part_of_face[faces], kind="stable")
    return np.split(faces[order], np.searchsorted(part_of_face[faces][order], np.arange(1, parts)))


def _is_whole(points: F32, counts: Codes, corners: Codes) -> bool:
    return (
        int(counts.min(initial=0)) >= 0
        and int(counts.sum()) == len(corners)
        and int(corners.min(initial=0)) >= 0
        and int(corners.max(initial=-1)) < len(points)
    )


def _scheme(mesh: Any, counts: Codes) -> str:
    """Returns a mesh's subdivision scheme; `none` for Loop unless all faces are triangles.

    A mesh with normals and no authored scheme is polygonal, since subdivided meshes have no normals.
    """
    attribute = mesh.GetSubdivisionSchemeAttr()
    if not attribute.HasAuthoredValue() and (
        mesh.GetNormalsAttr().HasAuthoredValue() or primvars.find_primvar(mesh.GetPrim(), "normals") is not None
    ):
        return "none"
    scheme = str(attribute.Get())
    return "none" if scheme == "loop" and int(counts.max(initial=3)) > 3 else scheme


def _primvar(prim: Any, name: str, faces: Faces, points: int, time: Any, notes: Notes) -> AtCorners | None:
    primvar = primvars.find_primvar(prim, name)
    if primvar is None:
        return None
    return primvars.at_corners(primvar, None, faces, points, time, notes)


def _normals(mesh: Any, scheme: str, faces: Faces, points: int, time: Any, notes: Notes, shape: Shape | None) -> AtCorners | None:
    """Returns the normals at the corners; None for subdivided meshes, and if the number of normals does not fit."""
    if scheme in REFINED:
        return None
    if shape is not None and shape.normals is not None:
        kind = "faceVarying" if len(shape.normals) == len(faces.corners) else "vertex"
        found = primvars.values_at_corners(shape.normals, None, kind, faces, points, mesh.GetPath(), notes)
        return None if found is None else replace(found, kinds=shape.straight)
    primvar = primvars.find_primvar(mesh.GetPrim(), "normals")
    if primvar is not None:
        return primvars.at_corners(primvar, 3, faces, points, time, notes)
    values = primvars.array(mesh.GetNormalsAttr().Get(time), 3)
    if len(values) == 0:
        return None
    path = mesh.GetNormalsAttr().GetPath()
    return primvars.values_at_corners(values, None, mesh.GetNormalsInterpolation(), faces, points, path, notes)


def _mesh_part(
    name: str,
    points: F32,
    faces: Faces,
    face_indices: Codes,
    attributes: dict[str, AtCorners],
    used_primvars: UsedPrimvars,
    mirrored: bool,
) -> Mesh | None:
    is_all = len(face_indices) == len(faces.counts)
    if is_all and not attributes and not mirrored and len(faces.counts) and bool((faces.counts == 3).all()):
        return Mesh(name, points.copy(), faces.corners.astype(np.int32).reshape(-1, 3))
    if not is_all:
        faces, corners = faces.selected(face_indices)
        attributes = {key: values.at_corners(corners) for key, values in attributes.items()}
    if len(faces.counts) == 0:
        return None
    used = {
        key: attributes[key] for key in ("", *used_primvars.uvs, used_primvars.color, used_primvars.opacity) if key in attributes
    }
    triangles = triangles_of(faces, points, mirrored)
    if all(values.by_point for values in used.values()) and is_all:
        first, vertex, point = None, faces.corners.astype(np.int32), np.arange(len(points))
        corner = np.zeros(len(points), np.int64)
        corner[faces.corners] = np.arange(len(faces.corners))
        first = corner
    else:
        first, vertex = joined(faces, list(used.values()))
        point = faces.corners[first]

    def vertex_values(key: str | None) -> F32 | None:
        return None if key is None or key not in used else np.ascontiguousarray(used[key].values[used[key].code[first]])

    result = Mesh(name, np.ascontiguousarray(points[point]), vertex[triangles], vertex_values(""))
    sets = [vertex_values(key) for key in used_primvars.uvs]
    result.uvs, result.uvs1 = (_flip_v(sets[k]) if k < len(sets) else None for k in (0, 1))
    result.colors = _colors(vertex_values(used_primvars.color), vertex_values(used_primvars.opacity))
    return result


def _flip_v(uvs: F32 | None) -> F32 | None:
    """Returns UVs with v measured from the image's upper edge; None without two components.

    USD measures v from the lower edge.
    """
    if uvs is None or uvs.shape[1] < 2:
        return None
    return np.ascontiguousarray(np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1))


def _colors(color: F32 | None, opacity: F32 | None) -> F32 | None:
    given = color if color is not None else opacity
    if given is None:
        return None
    found = np.ones((len(given), 4), np.float32)
    if color is not None:
        found[:, :3] = np.clip(color[:, :3] if color.shape[1] >= 3 else color[:, :1], 0, 1)
    if opacity is not None:
        found[:, 3] = np.clip(opacity[:, 0], 0, 1)
    return None if (found == 1).all() else found


def _with_matching_normals(parts: list[Mesh | None], is_creased: bool, is_bent: bool) -> list[Mesh | None]:
    """Returns the parts of a subdivided mesh with normals that match where the parts share positions.

    Creases become sharp, by splitting vertices, only if the mesh does not deform (`is_bent` false).
    """
    meshes = [mesh for mesh in parts if mesh is not None]
    if not meshes:
        return parts
    if is_creased and not is_bent:
        made = [
            replace(smooth, material=mesh.material)
            for smooth, mesh in zip(smoothed_together(meshes, surfaces=[0] * len(meshes)), meshes, strict=True)
        ]
    else:
        first, number = unique_threes(np.concatenate([mesh.positions for mesh in meshes]) + np.float32(0))  # turns -0 into 0
        ends = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
        normals = np.zeros((len(first), 3))
        for mesh, begin, end in zip(meshes, ends, ends[1:], strict=False):
            each = face_normals(mesh.positions, mesh.triangles)
            for k in range(3):
                corner = number[begin:end][mesh.triangles[:, k]]
                for axis in range(3):
                    normals[:, axis] += np.bincount(corner, each[:, axis], len(normals))
        shared = normals.astype(np.float32)[number]
        made = [replace(mesh, normals=shared[a:b]) for mesh, a, b in zip(meshes, ends, ends[1:], strict=False)]
    found = iter(made)
    return [None if mesh is None else next(found) for mesh in parts]
