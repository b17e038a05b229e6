"""Wavefront OBJ: polygons, groups and materials. One mesh a material; smooth normals are made where the file has none."""

from __future__ import annotations

from itertools import pairwise
from pathlib import PurePosixPath

import numpy as np

from renderer.errors import SceneError
from renderer.image.read import IMAGE_SUFFIXES
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed
from renderer.scene.readers.mtl import read_mtl
from renderer.scene.textures import TextureShelf

__all__ = ["read"]

MAX_BYTES = 400 << 20  # its text takes some ten times as much memory while it is read

Corner = tuple[int, int, int]  # position, uv, normal; -1 for none


class _Faces:
    """The triangles of one material as corners; a corner seen again is the same vertex."""

    def __init__(self) -> None:
        self.vertices: dict[Corner, int] = {}
        self.triangles: list[tuple[int, int, int]] = []

    def add(self, polygon: list[Corner]) -> None:
        numbers = [self.vertices.setdefault(corner, len(self.vertices)) for corner in polygon]
        for b, c in pairwise(numbers[1:]):
            self.triangles.append((numbers[0], b, c))


class _Lines:
    """What the lines of a file say."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.positions: list[str] = []
        self.uvs: list[str] = []
        self.normals: list[str] = []
        self.faces: dict[str | None, _Faces] = {}
        self.libraries: list[str] = []
        self.others = 0  # lines and points, which have no surface

    def read(self, text: str) -> None:
        current = self.faces.setdefault(None, _Faces())
        for number, line in enumerate(_logical_lines(text), 1):
            keyword, _, rest = line.partition(" ")
            if keyword == "v":
                self.positions.append(rest)
            elif keyword == "vt":
                self.uvs.append(rest)
            elif keyword == "vn":
                self.normals.append(rest)
            elif keyword == "f":
                current.add([self._corner(word, number) for word in rest.split()])
            elif keyword == "usemtl":
                current = self.faces.setdefault(rest.strip(), _Faces())
            elif keyword == "mtllib":
                self.libraries.append(rest.strip())
            elif keyword in ("l", "p", "curv", "surf"):
                self.others += 1

    def _corner(self, word: str, number: int) -> Corner:
        parts = word.split("/")
        try:
            values = [int(p) if p else 0 for p in parts[:3]]
        except ValueError:
            raise SceneError(f"{self.file}, line {number}: {word[:40]!r} is no corner of a face; write it as v/vt/vn") from None
        counts = (len(self.positions), len(self.uvs), len(self.normals))
        corner = [-1, -1, -1]
        for k, (value, count) in enumerate(zip(values, counts, strict=False)):
            if value == 0 and k > 0:
                continue
            at = value - 1 if value > 0 else count + value
            if not 0 <= at < (count if value < 0 else 1 << 31) or value == 0:
                raise SceneError(f"{self.file}, line {number}: a face names element {value} where {count} stand before it")
            corner[k] = at
        return corner[0], corner[1], corner[2]


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's meshes and materials to the description. Raises SceneError."""
    data = files.read(main)
    if len(data) > MAX_BYTES:
        raise SceneError(
            f"{main}: has {len(data) >> 20} MiB; an OBJ has at most {MAX_BYTES >> 20}. Export it as .glb or binary .ply"
        )
    lines = _Lines(main)
    lines.read(data.decode("utf-8", errors="replace"))
    positions = _table(lines.positions, 3, main, "v")
    uvs = _table(lines.uvs, 2, main, "vt")
    uvs[:, 1] = 1 - uvs[:, 1]  # OBJ counts v from the image's lower edge
    normals = _table(lines.normals, 3, main, "vn")
    shelf = TextureShelf(description, files)
    materials = _Materials(lines, files, shelf, description)
    for name, faces in lines.faces.items():
        if faces.triangles:
            mesh = _mesh(name or PurePosixPath(main).stem, faces, positions, uvs, normals, main)
            mesh.material = materials.number(name, has_uvs=mesh.uvs is not None)
            description.meshes.append(smoothed(mesh))
            description.instances.append(Instance(len(description.meshes) - 1))
    if lines.others:
        shelf.warn(f"{main}: {lines.others} lines, points or curves have no surface and are left out.")


def _logical_lines(text: str) -> list[str]:
    """Lines with tabs as spaces; one that ends in a backslash goes on in the next, whose own number then stays empty."""
    lines = [line.strip().replace("\t", " ") for line in text.splitlines()]
    for i in range(len(lines) - 2, -1, -1):
        if lines[i].endswith("\\"):
            lines[i], lines[i + 1] = f"{lines[i][:-1]} {lines[i + 1]}", ""
    return lines


def _table(rows: list[str], width: int, file: str, keyword: str) -> F32:
    """(N, width) float32 of rows of numbers; further numbers (w, vertex colours) are left out."""
    words = " ".join(rows).split()
    if len(words) != width * len(rows):
        words = [w for row in rows for w in ([*row.split(), "0"] if width == 2 else row.split())[:width]]
    try:
        table = np.array(words, np.float64).reshape(len(rows), width)
    except ValueError as error:
        wrong = next((r for r in rows if not _is_row(r, width)), "")
        raise SceneError(f"{file}: '{keyword} {wrong[:60]}' does not hold {width} numbers; export the file again") from error
    with np.errstate(over="ignore"):
        found = table.astype(np.float32)
    if not np.isfinite(found).all():
        wrong = rows[int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])]
        raise SceneError(f"{file}: '{keyword} {wrong[:60]}' is not finite; export the file again")
    return found


def _is_row(row: str, width: int) -> bool:
    try:
        return len([float(w) for w in row.split()]) >= min(width, 1 if width == 2 else width)
    except ValueError:
        return False


def _mesh(name: str, faces: _Faces, positions: F32, uvs: F32, normals: F32, file: str) -> Mesh:
    corners = np.array(list(faces.vertices), np.int64).reshape(-1, 3)
    for k, (table, what) in enumerate(((positions, "v"), (uvs, "vt"), (normals, "vn"))):
        if corners[:, k].max() >= len(table):
            raise SceneError(
                f"{file}: a face names {what} {corners[:, k].max() + 1} where the file has {len(table)}; export it again"
            )

    def pick(table: F32, k: int) -> F32 | None:
        if (corners[:, k] < 0).all():
            return None
        return np.where(corners[:, k : k + 1] >= 0, table[np.maximum(corners[:, k], 0)], np.float32(0))

    return Mesh(name, positions[corners[:, 0]], np.array(faces.triangles, np.int32), pick(normals, 2), pick(uvs, 1))


class _Materials:
    """The description's numbers of the materials that faces name."""

    def __init__(self, lines: _Lines, files: SceneFiles, shelf: TextureShelf, description: SceneDescription) -> None:
        self._file, self._files, self._shelf, self._description = lines.file, files, shelf, description
        self._numbers: dict[str | None, int] = {}
        self._found: dict[str, Material] = {}
        for library in lines.libraries:
            name = files.find(library, lines.file)
            names = [name] if name else [n for word in library.split() if (n := files.find(word, lines.file))]
            if not names:
                shelf.warn(
                    f"{lines.file}: its materials {library[:120]} are not among the files; add them. Rendered in grey meanwhile."
                )
            for n in names:
                self._found.update(read_mtl(files, n, shelf))
        self._bare = not lines.libraries

    def number(self, name: str | None, has_uvs: bool) -> int:
        if name not in self._numbers:
            material = self._found.get(name or "")
            if material is None:
                material = Material(name or "default")
                if self._bare and has_uvs:
                    material.base_color_texture = self._lone_texture(material)
                elif name is not None and self._found:
                    self._shelf.warn(f"{self._file}: no material file describes {name[:120]}; it is grey.")
            self._description.materials.append(material)
            self._numbers[name] = len(self._description.materials) - 1
        return self._numbers[name]

    def _lone_texture(self, material: Material) -> int | None:
        images = self._files.siblings(self._file, IMAGE_SUFFIXES)
        if len(images) != 1:
            return None
        texture = self._shelf.texture(self._shelf.image_file(images[0]))
        if texture is not None:
            material.base_color = (1.0, 1.0, 1.0)
            self._shelf.warn(f"{self._file}: names no material; the one image beside it, {images[0]}, is taken as its texture.")
        return texture
