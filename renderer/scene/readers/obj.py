"""Wavefront OBJ: polygons, groups and materials. One mesh a material; smooth normals are made where the file has none."""

from __future__ import annotations

import codecs
import re
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.image.read import IMAGE_SUFFIXES
from renderer.scene.closed import is_closed
from renderer.scene.description import F32, I32, Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed_together
from renderer.scene.origin import exact
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.mtl import read_mtl
from renderer.scene.readers.obj_lines import Statements, parse
from renderer.scene.textures import TextureShelf
from renderer.scene.unique import unique_threes

__all__ = ["read"]

_OF_LIGHT = (".exr", ".hdr", ".pic", ".pfm")  # images of what surrounds a scene, not of what its surfaces are
MAX_BYTES = 400 << 20  # of text; its arrays take about as much again


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's meshes and materials to the description. Raises SceneError."""
    data = files.read(main)
    if len(data) > MAX_BYTES:
        raise SceneError(
            f"{main}: has {len(data) >> 20} MiB; an OBJ has at most {MAX_BYTES >> 20}. Export it as .glb or binary .ply"
        )
    text = _as_utf8(data)
    try:
        said = parse(text, main)
    except SceneError as error:
        mended = _mended(text)
        if mended == text:
            raise
        try:
            said = parse(mended, main)
        except SceneError:
            raise error from None
        description.warnings.append(f"{main}: numbers with decimal commas, or that are none, are read as what they seem to mean.")
    if said.colors is None and b"#MRGB" in text:
        said = said._replace(colors=_polypaint(text, len(said.positions)))
    said = said._replace(positions=exact(said.positions))
    said.uvs[:, 1] = 1 - said.uvs[:, 1]  # OBJ counts v from the image's lower edge
    _check_corners(said, main)
    shelf = TextureShelf(description, files)
    materials = _Materials(main, said.libraries, files, shelf, description)
    stretches = _stretches(said)
    meshes = _meshes([name or PurePosixPath(main).stem for name in stretches], said, list(stretches.values()))
    shown = [(name, mesh) for name, mesh in zip(stretches, meshes, strict=True) if mesh is not None]
    for name, mesh in shown:
        mesh.material = materials.number(name, mesh)
    bare = [mesh for _, mesh in shown]
    for mesh in bare if not len(said.normals) and _is_faceted(text) else smoothed_together(bare):
        description.meshes.append(mesh)
        description.instances.append(Instance(len(description.meshes) - 1, name=mesh.name))
    if said.others:
        shelf.warn(f"{main}: {said.others} lines, points or curves have no surface and are left out.")


def _as_utf8(data: bytes) -> bytes:
    """The text in UTF-8: some tools of Windows write UTF-16, or mark UTF-8."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def _polypaint(text: bytes, vertices: int) -> F32 | None:
    """(V, 3) sRGB of ZBrush's comments: a mask and red, green, blue in hexadecimal for each vertex; None of damaged ones."""
    digits = b"".join(re.findall(rb"(?m)^#MRGB[ \t]+([0-9a-fA-F]+)", text))
    if len(digits) < 8 * vertices:
        return None
    codes = np.frombuffer(bytes.fromhex(digits[: 8 * vertices].decode()), np.uint8).reshape(-1, 4)
    return codes[:, 1:].astype(np.float32) / np.float32(255)


def _is_faceted(text: bytes) -> bool:
    """Whether it says of its faces that they are not smooth, and of none that they are."""
    is_said, at = False, -1
    while (at := text.find(b"\ns ", at + 1)) >= 0:
        if text[at + 3 : at + 100].split(None, 1)[:1] not in ([b"off"], [b"0"]):
            return False
        is_said = True
    return is_said


def _mended(text: bytes) -> bytes:
    """With points in numbers, and 0 for normals and texture coordinates that are none; positions that are none stay."""

    def line(found: re.Match[bytes]) -> bytes:
        numbers = re.sub(rb"(?<=\d),(?=\d)", b".", found[2])
        numbers = re.sub(rb"(?<=[\d.])[dD](?=[-+]?\d)", b"e", numbers)
        if found[1] != b"v":
            numbers = re.sub(rb"(?i)(?<![\w.])[-+]?(?:\d\.?#\w+|nan(?:\(\w*\))?|inf(?:inity)?)(?![\w.])", b"0", numbers)
        return found[1] + numbers

    return re.sub(rb"(?m)^(v[nt]?)([ \t][^\r\n]*)", line, text)


def _check_corners(said: Statements, file: str) -> None:
    highest = said.corners.max(axis=0, initial=-1)
    tables: list[tuple[npt.NDArray[Any], str]] = [(said.positions, "v"), (said.uvs, "vt"), (said.normals, "vn")]
    for k, (table, what) in enumerate(tables):
        if highest[k] >= len(table):
            raise SceneError(f"{file}: a face names {what} {highest[k] + 1} where the file has {len(table)}; export it again")


def _stretches(said: Statements) -> dict[str | None, npt.NDArray[np.int64]]:
    """The faces of each material, by its name; None before any is named."""
    ends = [face for face, _ in said.materials[1:]] + [len(said.starts) - 1]
    stretches: list[tuple[str | None, int, int]] = [(None, 0, said.materials[0][0] if said.materials else ends[0])]
    stretches += [(name, face, end) for (face, name), end in zip(said.materials, ends, strict=False)]
    found: dict[str | None, list[npt.NDArray[np.int64]]] = {}
    for name, first, last in stretches:
        found.setdefault(name, []).append(np.arange(first, last))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _meshes(names: list[str], said: Statements, stretches: list[npt.NDArray[np.int64]]) -> list[Mesh | None]:
    """The meshes of some faces each, polygons cut into fans; None where they have no triangle."""
    faces = np.concatenate(stretches)
    count = np.maximum(said.starts[faces + 1] - said.starts[faces] - 2, 0)
    first = np.repeat(said.starts[faces], count)
    step = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    fans = np.stack([first, first + step + 1, first + step + 2], axis=1)
    ends = np.cumsum([0, *map(len, stretches)])
    begin = np.concatenate([[0], np.cumsum(count)])[ends]  # the first triangle of each
    corners, triangles, starts = _joined(said.corners[fans.reshape(-1)], 3 * begin)
    tables: list[npt.NDArray[Any]] = [said.positions, said.uvs, said.normals]
    positions, uvs, normals = (_picked(table, corners[:, k]) for k, table in enumerate(tables))
    has = [np.concatenate([[0], np.cumsum(corners[:, k] >= 0)])[starts] for k in (1, 2)]
    colors = None if said.colors is None else said.colors[corners[:, 0]]
    found: list[Mesh | None] = []
    for i, name in enumerate(names):
        a, b = starts[i], starts[i + 1]
        if begin[i] == begin[i + 1]:
            found.append(None)
            continue
        numbers = triangles[3 * begin[i] : 3 * begin[i + 1]].reshape(-1, 3) - np.int32(a)
        own_uvs, own_normals = (
            None if known[i] == known[i + 1] else table[a:b] for known, table in zip(has, (uvs, normals), strict=True)
        )
        mesh = Mesh(name, positions[a:b], numbers, own_normals, own_uvs)
        if colors is not None:
            mesh.colors = vertex_colors(colors[a:b])
        found.append(mesh)
    return found


def _picked(table: npt.NDArray[Any], at: I32) -> npt.NDArray[Any]:
    """Rows of a table; zeros for -1."""
    if not len(table):
        return np.zeros((len(at), table.shape[1]), np.float32)
    return np.where(at[:, None] >= 0, table[np.maximum(at, 0)], table.dtype.type(0))


def _joined(corners: I32, begin: npt.NDArray[np.int64]) -> tuple[I32, I32, npt.NDArray[np.int64]]:
    """Corners that are the same made one vertex: the (V, 3) vertices, the vertex of each corner, and where the vertices of each
    mesh begin. begin: where its corners do, with the end of all."""
    first, number = unique_threes(corners)
    if len(begin) > 2:
        mesh = np.repeat(np.arange(len(begin) - 1, dtype=np.int32), np.diff(begin))
        first, number = unique_threes(np.column_stack([number, mesh, np.zeros_like(mesh)]))
    return corners[first], number, np.searchsorted(first, begin)


class _Materials:
    """The description's numbers of the materials that faces name."""

    def __init__(
        self, file: str, libraries: list[str], files: SceneFiles, shelf: TextureShelf, description: SceneDescription
    ) -> None:
        self._file, self._files, self._shelf, self._description = file, files, shelf, description
        self._found: dict[str, Material] = {}
        for library in libraries:
            name = files.find(library, file)
            names = [name] if name else [n for word in library.split() if (n := files.find(word, file))]
            if not names:
                shelf.warn_of_surface(
                    f"{file}: its materials {library[:120]} are not among the files; add them. Rendered in grey meanwhile."
                )
            for n in names:
                self._found.update(read_mtl(files, n, shelf))
        self._bare = not libraries

    def number(self, name: str | None, mesh: Mesh) -> int:
        """The description's number of a material. Glass without an inside is a pane: see docs/scene-format.md."""
        material = self._found.get(name or "")
        if material is None:
            material = Material(name or "default")
            if mesh.colors is not None:
                material.base_color = (1.0, 1.0, 1.0)
            if self._bare and mesh.uvs is not None:
                material.base_color_texture = self._lone_texture(material)
            elif name is not None and self._found:
                self._shelf.warn_of_surface(f"{self._file}: no material file describes {name[:120]}; it is grey.")
        if material.kind == "glass":
            material.thin = not is_closed(mesh.positions, mesh.triangles)
        self._description.materials.append(material)
        return len(self._description.materials) - 1

    def _lone_texture(self, material: Material) -> int | None:
        images = [name for name in self._files.siblings(self._file, IMAGE_SUFFIXES) if not name.lower().endswith(_OF_LIGHT)]
        if len(images) != 1:
            return None
        texture = self._shelf.texture(self._shelf.image_file(images[0]))
        if texture is not None:
            material.base_color = (1.0, 1.0, 1.0)
            self._shelf.warn_of_surface(
                f"{self._file}: names no material; the one image beside it, {images[0]}, is taken as its texture."
            )
        return texture
