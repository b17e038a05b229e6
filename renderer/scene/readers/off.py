"""Reads OFF, Geomview's object file format: polygons with the normals, colours and UVs that its prefixes declare.

Source: the Geomview manual, "OFF: Object File Format". Binary files, and points of other dimensions (4OFF, nOFF), are not
supported.
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.points import add_points
from renderer.scene.readers.polygon_meshes import fractions, triangulated, with_corner_values, without_bad_vertices
from renderer.scene.text_encoding import decoded, with_decimal_points
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read"]

F64 = npt.NDArray[np.float64]
_HEAD = re.compile(r"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b[ \t]*(BINARY\b)?")
_COMMENT = re.compile(r"#[^\n]*")
_SEVERAL = 3  # numbers after a face's corners: at least this many are a colour, fewer a colour map index


class _Head(NamedTuple):
    has_uvs: bool
    has_colors: bool
    has_normals: bool


class _Faces(NamedTuple):
    counts: npt.NDArray[np.int64]
    corners: npt.NDArray[np.int64]
    colors: F32 | None  # (F, 4) sRGB, 0 to 1
    uncolored: int
    mapped: int  # faces coloured by rows of a colour map


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's surface or points to the description.

    Raises SceneError if the file is damaged or of an unsupported kind.
    """
    shelf = TextureShelf(description, files)
    text = _COMMENT.sub("", decoded(files.read(main)))
    found = _HEAD.match(text)
    if found is not None and (found[4] or found[5] or found[6]):
        raise SceneError(
            Sentence(
                "off-kind-unsupported",
                "{file} is of the kind {kind}, which is not supported; export it as plain OFF text",
                file=main,
                kind=found[0].strip(),
            )
        )
    text, commas = with_decimal_points(text)
    if commas:
        shelf.warn(
            Sentence(
                "mesh-decimal-commas",
                "{file}: {count} numbers have decimal commas, which are read as points.",
                file=main,
                count=commas,
            )
        )
    lines = [line for line in text[found.end() if found else 0 :].splitlines() if line and not line.isspace()]
    head = _Head(*(bool(found and found[k]) for k in (1, 2, 3)))
    vertices, faces = _parse_counts(lines, main)
    try:
        rows = _vertices(lines[1 : vertices + 1], vertices, main)
        polygons = _faces(lines[vertices + 1 : vertices + 1 + faces], faces, main)
    except ValueError as error:
        raise SceneError(
            Sentence(
                "off-words-among-numbers",
                "{file} contains words among its numbers ({error}); export it again",
                file=main,
                error=library_message(error),
            )
        ) from None
    _add(head, rows, polygons, main, shelf, description)


def _parse_counts(lines: list[str], main: str) -> tuple[int, int]:
    words = lines[0].split() if lines else []
    if len(words) < 2 or not all(word.isascii() and word.isdigit() and len(word) < 16 for word in words[:2]):
        raise SceneError(
            Sentence(
                "off-counts-missing",
                "{file} is damaged or not an .off file. Export it again (the counts of vertices and faces are missing)",
                file=main,
            )
        )
    vertices, faces = int(words[0]), int(words[1])
    if not vertices:
        raise SceneError(Sentence("off-vertices-missing", "{file} contains no vertices; export it again", file=main))
    if vertices + faces > len(lines) - 1:
        raise SceneError(
            Sentence(
                "off-file-cut-off",
                "{file} has {found} of {declared} lines of vertices and faces; the upload or download was interrupted, repeat it",
                file=main,
                found=len(lines) - 1,
                declared=vertices + faces,
            )
        )
    return vertices, faces


def _vertices(lines: list[str], count: int, main: str) -> F64:
    """Returns (V, w) rows of vertex numbers. Raises SceneError if their lengths differ."""
    words = [line.split() for line in lines]
    width = len(words[0])
    if width < 3 or any(len(row) != width for row in words):
        raise SceneError(
            Sentence(
                "off-vertex-number-count-wrong",
                "{file}: its vertices do not have {width} numbers each; export it again",
                file=main,
                width=max(width, 3),
            )
        )
    return np.array(words, np.float64).reshape(count, width)


def _faces(lines: list[str], count: int, main: str) -> _Faces:
    words = [line.split() for line in lines]
    counts = np.array([int(row[0]) for row in words], np.int64)
    if any(size < 0 or len(row) <= size for size, row in zip(counts.tolist(), words, strict=True)):
        raise SceneError(
            Sentence("off-face-incomplete", "{file}: a face has fewer corners than declared; export it again", file=main)
        )
    corners = np.array([int(word) for row in words for word in row[1 : int(row[0]) + 1]], np.int64)
    rest = [row[int(row[0]) + 1 :] for row in words]
    has = np.array([len(each) >= _SEVERAL for each in rest], bool)
    mapped = sum(len(each) == 1 for each in rest)
    colors = None
    if has.any():
        colors = np.ones((count, 4), np.float32)
        for width in (3, 4):
            of = np.flatnonzero([len(each) == width or (width == 4 and len(each) > width) for each in rest])
            if len(of):
                colors[of, :width] = _fractions([rest[k][:width] for k in of.tolist()])
    return _Faces(counts, corners, colors, int((~has).sum()), mapped)


def _fractions(rows: list[list[str]]) -> F32:
    """Returns (N, 3 or 4) colours in 0..1 from rows of words.

    If any integer in a row of integers exceeds 1, all rows of integers are divided by 255. The other rows are converted by
    `fractions`.
    """
    whole = np.array([all(word.lstrip("+").isdigit() for word in row) for row in rows])
    values = np.array(rows, np.float64)
    found = np.empty(values.shape, np.float32)
    if whole.any() and values[whole].max() > 1:
        found[whole] = np.clip(values[whole], 0, 255) / 255
        found[~whole] = fractions(values[~whole])
        return found
    return fractions(values)


def _add(head: _Head, rows: F64, faces: _Faces, main: str, shelf: TextureShelf, description: SceneDescription) -> None:
    positions = in_exact_type(rows[:, :3])
    at = 3
    normals: F32 | None = None
    uvs: F32 | None = None
    colors: F32 | None = None
    if head.has_normals:
        normals, at = _columns(rows, at, 3, main).astype(np.float32), at + 3
    if head.has_colors:
        width = max(rows.shape[1] - at - (2 if head.has_uvs else 0), 3)
        colors, at = fractions(_columns(rows, at, min(width, 4), main)), at + min(width, 4)
    if head.has_uvs:
        uvs, at = _columns(rows, at, 2, main).astype(np.float32), at + 2
        uvs[:, 1] = 1 - uvs[:, 1]  # OFF measures v from the lower edge
    further = rows.shape[1] - at
    if further in (3, 4) and at == 3 and (rows[:, at:] >= 0).all():
        colors = fractions(rows[:, at:])
        shelf.warn_of_surface(
            Sentence(
                "off-vertex-numbers-as-colours",
                "{file}: its vertices have {count} more numbers than the header declares; they are read as colours.",
                file=main,
                count=further,
            )
        )
    elif further:
        shelf.warn_of_surface(
            Sentence(
                "off-vertex-numbers-dropped",
                "{file}: {count} additional numbers per vertex are left out.",
                file=main,
                count=further,
            )
        )
    if faces.mapped:
        shelf.warn_of_surface(
            Sentence(
                "off-colour-map-dropped",
                "{file}: {count} faces have colours from a colour map, which are left out.",
                file=main,
                count=faces.mapped,
            )
        )
    if not (faces.counts >= 3).any():
        add_points(positions, colors, np.eye(4), main, description, shelf)
        return
    cut = triangulated(faces.counts, faces.corners, positions, main, shelf)
    mesh = Mesh(PurePosixPath(main).stem, positions, faces.corners[cut.triangles].astype(np.int32), normals, uvs)
    if colors is not None:
        mesh.colors = vertex_colors(colors)
    elif faces.colors is not None:
        if faces.uncolored:
            shelf.warn_of_surface(
                Sentence(
                    "off-faces-without-colour",
                    "{file}: {count} of {total} faces have no colour; they are shown white.",
                    file=main,
                    count=faces.uncolored,
                    total=len(faces.counts),
                )
            )
        linear = vertex_colors(faces.colors)
        mesh = mesh if linear is None else with_corner_values(mesh, None, np.repeat(linear[cut.face], 3, axis=0))
    mesh = without_bad_vertices(mesh)
    material = Material()
    if colors is not None or faces.colors is not None:
        material.base_color = (1.0, 1.0, 1.0)
    if mesh.colors is not None and (mesh.colors[:, 3] < 1).any():
        material.alpha_mode = "blend"
    description.materials.append(material)
    mesh.material = len(description.materials) - 1
    description.meshes.append(smoothed(mesh))
    description.instances.append(Instance(len(description.meshes) - 1, name=mesh.name))


def _columns(rows: F64, at: int, count: int, main: str) -> F64:
    if at + count > rows.shape[1]:
        raise SceneError(
            Sentence(
                "off-vertex-numbers-too-few",
                "{file}: its vertices have {found} numbers, fewer than the header declares; export it again",
                file=main,
                found=rows.shape[1],
            )
        )
    return rows[:, at : at + count]
