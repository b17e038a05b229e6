"""Meshes of shapes in object space, from files and analytic shapes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from renderer.errors import SceneError
from renderer.image.tonemap import encode_srgb
from renderer.scene.description import Mesh, SceneDescription
from renderer.scene.normals import smoothed
from renderer.scene.readers import ply
from renderer.scene.readers.by_format import read_file
from renderer.scene.readers.mitsuba import parametric_shapes
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.serialized import read_serialized
from renderer.sentences import Sentence

__all__ = ["FORMULAS", "MESH_FILES", "file_of", "flipped", "meshes_of", "wind_to_normals"]

MESH_FILES = ("obj", "ply", "serialized")
_NORMALS = {"obj": rb"(?m)^\s*vn\s", "ply": rb"\A[^\0]{0,20000}?property\s+\w+\s+nx\b"}  # match files with normals
_LINEAR_COLORS = re.compile(rb"\A[^\0]{0,20000}?property\s+(?:float|double|half)\w*\s+(?:r|red)\b")
_EVERY_EDGE = 181.0
FORMULAS = ("rectangle", "cube", "disk", "cylinder")


def meshes_of(shape: Element, document: Document, attribute: str = "") -> list[tuple[Mesh, np.ndarray]]:
    """Returns the meshes of a shape, each with its (4, 4) transform to the shape's space.

    attribute: mesh attribute used as colour, such as face_heat; empty for the file's own colours. Meshes without the attribute
    have no colours. Raises SceneError if the shape's file is missing or invalid.
    """
    name = shape.id or shape.type
    if shape.type == "rectangle":
        found = [(parametric_shapes.rectangle(name), np.eye(4))]
    elif shape.type == "cube":
        found = [(parametric_shapes.cube(name), np.eye(4))]
    elif shape.type == "disk":
        found = [(parametric_shapes.disk(name), np.eye(4))]
    elif shape.type == "cylinder":
        found = [(parametric_shapes.tube(name), _cylinder_transform(shape))]
    else:
        found = _of_file(shape, document, attribute)
    if shape.boolean("flip_normals", False):
        found = [(flipped(mesh), place) for mesh, place in found]
    return found


def file_of(shape: Element, document: Document) -> str:
    """Returns the name of a shape's file. Raises SceneError if the file is missing."""
    wanted = str(shape.get("filename", ""))
    name = document.files.find(wanted, shape.file)
    if name is None:
        raise SceneError(
            Sentence(
                "mitsuba-file-missing",
                "{file}: {name} is not among the files; add it",
                file=shape.file,
                name=PurePosixPath(wanted).name[:120] or shape.description,
            )
        )
    return name


def _of_file(shape: Element, document: Document, attribute: str) -> list[tuple[Mesh, np.ndarray]]:
    name = file_of(shape, document)
    if shape.type == "serialized":
        index = int(shape.number("shape_index", 0))
        mesh = read_serialized(document.files.read(name), name, index)
        if attribute not in ("", "vertex_color"):
            mesh.colors = None
        return [(_with_mitsuba_normals(mesh, shape, mesh.normals is not None), np.eye(4))]
    part = SceneDescription(name=name)
    if attribute and shape.type == "ply":
        ply.read_data(document.files.read(name), document.files, name, part, attribute=attribute)
    else:
        read_file(document.files, name, part)
    if shape.type == "obj" and not shape.boolean("flip_tex_coords", True):
        _flip(part)
    if shape.type == "ply" and not shape.boolean("flip_tex_coords", False):
        _flip(part)  # Mitsuba uses v unchanged, other programs measure it from the bottom
    for sentence in part.warnings if shape.type == "ply" else ():  # Mitsuba ignores OBJ's materials
        document.warn(sentence)
    has_normals = re.search(_NORMALS[shape.type], document.files.read(name)) is not None
    shaded = [_with_mitsuba_normals(mesh, shape, has_normals) for mesh in part.meshes]
    if attribute and shape.type != "ply":
        shaded = [replace(mesh, colors=mesh.colors if attribute == "vertex_color" else None) for mesh in shaded]
    elif not attribute and _LINEAR_COLORS.search(document.files.read(name)) is not None:
        shaded = [mesh if mesh.colors is None else replace(mesh, colors=_srgb_values(mesh.colors)) for mesh in shaded]
    return [(replace(shaded[each.mesh]), np.asarray(each.transform)) for each in part.instances]


def _srgb_values(colors: np.ndarray) -> np.ndarray:
    """Returns mesh colours converted back to the file's sRGB values, which Mitsuba uses as if they were linear."""
    return np.column_stack([encode_srgb(colors[:, :3]), colors[:, 3]]).astype(np.float32)


def _flip(part: SceneDescription) -> None:
    part.meshes = [
        mesh if mesh.uvs is None else replace(mesh, uvs=np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]]).astype(np.float32))
        for mesh in part.meshes
    ]


def _with_mitsuba_normals(mesh: Mesh, shape: Element, has_normals: bool) -> Mesh:
    """Returns the mesh with the normals that Mitsuba would use, of the first kind that applies.

    These are: face normals if the shape requests them; the file's normals; otherwise vertex normals that are smooth over all
    edges.
    """
    if shape.boolean("face_normals", False):
        return replace(mesh, normals=None)
    return mesh if has_normals else smoothed(replace(mesh, normals=None), _EVERY_EDGE)


def flipped(mesh: Mesh) -> Mesh:
    """Returns the mesh with reversed winding and negated normals."""
    normals = None if mesh.normals is None else -mesh.normals
    return replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]), normals=normals)


def wind_to_normals(mesh: Mesh) -> Mesh:
    """Returns the mesh with its triangles facing along their vertex normals, the side on which Mitsuba's lights emit."""
    if mesh.normals is None:
        return mesh
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    towards = mesh.normals[mesh.triangles].sum(axis=1, dtype=np.float64)
    opposed = np.einsum("ij,ij->i", np.cross(b - a, c - a), towards) < 0
    if not opposed.any():
        return mesh
    triangles = mesh.triangles.copy()
    triangles[opposed] = triangles[opposed][:, ::-1]
    return replace(mesh, triangles=triangles)


def _cylinder_transform(shape: Element) -> np.ndarray:
    """Returns the transform of a cylinder between its two points. Raises SceneError if its length or radius is 0."""
    p0, p1 = (np.asarray(shape.get(key, default), float) for key, default in (("p0", (0, 0, 0)), ("p1", (0, 0, 1))))
    radius = shape.number("radius", 1.0)
    axis = p1 - p0
    length = float(np.linalg.norm(axis))
    if not length > 0 or not radius > 0:
        raise SceneError(
            Sentence(
                "mitsuba-shape-without-extent",
                "{file}: {what} has a length or radius of 0; give another",
                file=shape.file,
                what=shape.description,
            )
        )
    z = axis / length
    # Mitsuba's frame about an axis: Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017.
    sign = float(np.copysign(1.0, z[2]))
    a = -1.0 / (sign + z[2])
    x = np.array([1 + sign * z[0] ** 2 * a, sign * z[0] * z[1] * a, -sign * z[0]])
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2], place[:3, 3] = x * radius, np.cross(z, x) * radius, axis, p0
    return place
