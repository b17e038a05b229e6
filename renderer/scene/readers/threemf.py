"""Reads 3MF files (3MF Core 1.3, Materials and Properties 1.2, Production 1.1).

Reads objects, components, base materials, colours and textures. Coordinates are in the file's own unit, as for STL; 3MF's up
axis Z becomes Y.
"""

from __future__ import annotations

import io
import string
import zipfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.deduplicate import used_among
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import product
from renderer.scene.normals import smoothed_together
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.expansion_limits import check_expansion
from renderer.scene.readers.threemf_parts import NotSolid
from renderer.scene.readers.threemf_relations import relations_of
from renderer.scene.readers.threemf_rows import MARK, Rows, cut_out, transform_of
from renderer.scene.readers.threemf_slicers import PAINTED, filaments_of
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, count_of
from renderer.zips import DAMAGED, is_bomb

__all__ = ["read"]

F64 = npt.NDArray[np.float64]

MAX_PART_BYTES = 2 << 30
MAX_INSTANCES = 500_000
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_NOT_READ = {"compositematerials", "multiproperties", "beamlattice", "slicestack", "displacementmesh", "booleans", "levelset"}
_WRAPS: dict[str, Wrap] = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp", "none": "clamp"}
_BUILD = ("", "")
_WHITE = (255, 255, 255, 255)


@dataclass
class _Group:
    """A property group that triangles refer to: base materials, colours, or texture coordinates of one image."""

    kind: str
    values: list[Any] = field(default_factory=list)
    texture: str = ""


@dataclass
class _Object:
    """An object: a mesh, or a group of components.

    triangles: six numbers per triangle, the vertices v1, v2, v3 and the property index of each corner, -1 for none.
    """

    name: str
    type: str
    group: str
    index: int
    vertices: list[float] = field(default_factory=list)
    triangles: list[int] = field(default_factory=list)
    groups: list[str | None] = field(default_factory=list)
    components: list[tuple[str, str, F64]] = field(default_factory=list)  # path, object, transform
    rows: list[Rows] = field(default_factory=list)  # lists parsed by threemf_rows.py
    true: list[str] = field(default_factory=list)  # names of metadata whose value is true

    @property
    def points(self) -> npt.NDArray[Any]:
        """Returns (V, 3) vertex positions."""
        taken = [rows.stacked(("x", "y", "z")) for rows in self.rows if "x" in rows.columns]
        return in_exact_type(np.concatenate([*taken, np.array(self.vertices).reshape(-1, 3)]))

    @property
    def corners(self) -> npt.NDArray[np.int64]:
        """Returns (T, 3) vertex indices of the triangles."""
        own = np.array(self.triangles, np.int64).reshape(-1, 6)[:, :3]
        return np.concatenate([*(rows.stacked(("v1", "v2", "v3")) for rows in self.rows if "v1" in rows.columns), own])

    @property
    def corner_properties(self) -> npt.NDArray[np.int64]:
        """Returns (T, 3) the property index of each corner."""
        found = []
        for rows in self.rows:
            if "v1" in rows.columns:
                first = rows.columns.get("p1", np.full(len(rows), -1))
                found.append(np.column_stack([rows.columns.get(name, first) for name in ("p1", "p2", "p3")]))
        whole = np.concatenate([*found, np.array(self.triangles, np.int64).reshape(-1, 6)[:, 3:]])
        return np.where(whole < 0, self.index, whole)

    @property
    def group_of(self) -> tuple[npt.NDArray[np.int64], list[str]]:
        """Returns (T,) the property group index of each triangle, and the groups' ids by index."""
        found: list[npt.NDArray[np.int64]] = []
        number: dict[str, int] = {}
        for rows in self.rows:
            if "v1" in rows.columns and "pid" not in rows.columns:
                found.append(np.full(len(rows), number.setdefault(self.group, len(number))))
            elif "v1" in rows.columns:
                said, which = np.unique(rows.columns.get("pid", np.full(len(rows), -1)), return_inverse=True)
                names = [self.group if each < 0 else str(each) for each in said.tolist()]
                found.append(np.array([number.setdefault(name, len(number)) for name in names])[which])
        names = [self.group if name is None else name for name in self.groups]
        found.append(np.array([number.setdefault(name, len(number)) for name in names], np.int64))
        return np.concatenate(found).astype(np.int64), list(number)


class _Model:
    """The contents of one model part of the package."""

    def __init__(self, data: bytes, path: str, file: str) -> None:
        self.path, self._file = path, file
        self.objects: dict[str, _Object] = {}
        self.items: list[tuple[str, str, F64]] = []
        self.groups: dict[str, _Group] = {}
        self.textures: dict[str, tuple[str, Wrap, Wrap]] = {}
        self.left_out: set[str] = set()
        self.odd: Counter[str] = Counter()  # number of replaced values by kind
        self._object: _Object | None = None
        self._group: _Group | None = None
        self._metadata = ""
        data, lists = cut_out(data)
        self._lists = dict(enumerate(lists))
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.CharacterDataHandler = self._text
        parser.ProcessingInstructionHandler = self._add_list
        parser.EntityDeclHandler = self._entity
        try:
            parser.Parse(data, True)
        except (expat.ExpatError, ValueError, KeyError) as error:
            raise SceneError(
                Sentence(
                    "3mf-part-damaged",
                    "{file}: its part {path} is damaged ({error}); export it again",
                    file=file,
                    path=path[:80],
                    error=library_message(error),
                )
            ) from error

    def _entity(self, *_: Any) -> None:
        raise SceneError(
            Sentence(
                "xml-entities-forbidden",
                "{file} declares XML entities, which are not allowed; remove its DOCTYPE",
                file=self._file,
            )
        )

    def _text(self, text: str) -> None:
        if self._metadata and self._object is not None and text.strip().lower() == "true":
            self._object.true.append(self._metadata)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        made = self._object
        self._metadata = attributes.get("name", "") if name == "metadata" else ""
        if name == "vertex" and made is not None:
            made.vertices += float(attributes["x"]), float(attributes["y"]), float(attributes["z"])
        elif name == "triangle" and made is not None:
            first = int(attributes.get("p1", -1))
            corners = first, int(attributes.get("p2", first)), int(attributes.get("p3", first))
            made.triangles += int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]), *corners
            made.groups.append(attributes.get("pid"))
            if len(attributes) > 3 and any(key.endswith(PAINTED) for key in attributes):
                self.left_out.add(Sentence("3mf-painted-colours", "colours painted in a slicer"))
        elif name == "object":
            index = int(attributes.get("pindex", -1))
            self._object = _Object(attributes.get("name", ""), attributes.get("type", "model"), attributes.get("pid", ""), index)
            self.objects[attributes["id"]] = self._object
        elif name == "component" and made is not None:
            made.components.append(self._parse_component(attributes))
        elif name == "item":
            self.items.append(self._parse_component(attributes))
        elif name in ("basematerials", "colorgroup", "texture2dgroup"):
            self._group = _Group(name, texture=attributes.get("texid", ""))
            self.groups[attributes["id"]] = self._group
        elif name == "base" and self._group is not None:
            self._group.values.append((attributes.get("name", ""), self._color(attributes.get("displaycolor", ""))))
        elif name == "color" and self._group is not None:
            self._group.values.append(self._color(attributes.get("color", "")))
        elif name == "tex2coord" and self._group is not None:
            self._group.values.append((float(attributes["u"]), float(attributes["v"])))
        elif name == "texture2d":
            words = [attributes.get(key, "wrap") for key in ("tilestyleu", "tilestylev")]
            self.odd[Sentence("3mf-tile-styles", "unknown tile styles, read as wrap")] += sum(
                word not in _WRAPS for word in words
            )
            ways = [_WRAPS.get(word, "repeat") for word in words]
            self.textures[attributes["id"]] = attributes.get("path", ""), ways[0], ways[1]
        elif name in _NOT_READ:
            self.left_out.add(name)

    def _add_list(self, target: str, number: str) -> None:
        """Adds a list of vertices or triangles, which `threemf_rows.py` cut out of the XML, to the current object.

        Each list is added at most once, since a file could repeat the processing instruction that stands for it.
        """
        rows = self._lists.pop(int(number), None) if target == MARK else None
        if rows is not None and self._object is not None:
            self._object.rows.append(rows)

    def _color(self, word: str) -> tuple[int, int, int, int]:
        found = _color(word)
        self.odd[Sentence("3mf-colours-malformed", "colours that are not #RRGGBB or #RRGGBBAA and are shown white")] += (
            found is None
        )
        return found or _WHITE

    def _parse_component(self, attributes: dict[str, str]) -> tuple[str, str, F64]:
        path = next((value for key, value in attributes.items() if key.rpartition(":")[2] == "path"), self.path)
        return path, attributes["objectid"], transform_of(attributes.get("transform", ""))


def _color(word: str) -> tuple[int, int, int, int] | None:
    """Returns the sRGB codes of a colour #RRGGBB or #RRGGBBAA; None if malformed."""
    digits = word.strip().lstrip("#")
    if len(digits) not in (6, 8) or not all(digit in string.hexdigits for digit in digits):
        return None
    value = bytes.fromhex(digits)
    return value[0], value[1], value[2], value[3] if len(value) == 4 else 255


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the objects in the file's build to the description. Raises SceneError if the file is damaged."""
    _Reader(files, main, description).read()


class _Reader:
    def __init__(self, files: SceneFiles, main: str, description: SceneDescription) -> None:
        self._main, self._description = main, description
        self._shelf = TextureShelf(description, files)
        try:
            self._package = zipfile.ZipFile(io.BytesIO(files.read(main)))
        except DAMAGED as error:
            raise SceneError(
                Sentence(
                    "3mf-file-damaged",
                    "{file} is damaged or not a 3MF file. Export it again ({error})",
                    file=main,
                    error=library_message(error),
                )
            ) from error
        self._names = {name.lower().lstrip("/"): name for name in self._package.namelist()}
        self._filaments = filaments_of(self._names, self._bytes, main)
        self._not_solid = NotSolid(self._names, self._bytes, main)
        self._models: dict[str, _Model] = {}
        self._odd: Counter[str] = Counter()  # number of replaced values by kind
        self._surfaces: list[int] = []
        self._made: dict[tuple[str, str, str | None], list[int]] = {}
        self._materials: dict[Any, int] = {}

    def read(self) -> None:
        """Adds all items in the file's build to the description."""
        first = len(self._description.meshes)
        root = self._model(self._root())
        items = root.items or [(root.path, number, np.eye(4)) for number in root.objects]
        if not root.items:
            self._shelf.warn(
                Sentence("3mf-build-empty", "{file}: its build is empty; all of its objects are shown.", file=self._main)
            )
        self._check_expansion([(path, number) for path, number, _ in items])
        for path, number, place in items:
            self._add_object(path, number, product(_UPRIGHT, place), 0)
        self._description.meshes[first:] = smoothed_together(self._description.meshes[first:], surfaces=self._surfaces)
        left = sorted({words for model in self._models.values() for words in model.left_out})
        if parts := self._not_solid.left_out:
            listed = [count_of(count, kind) for kind, count in sorted(parts.items())]
            self._shelf.warn(
                Sentence(
                    "3mf-objects-not-printed",
                    "{file}: parts that are not printed are left out: {objects}.",
                    file=self._main,
                    objects=listed,
                )
            )
        if left:
            self._shelf.warn(
                Sentence("3mf-parts-left-out", "{file}: not read and left out: {parts}.", file=self._main, parts=[*left])
            )
        odd = sum((model.odd for model in self._models.values()), self._odd)
        if odd:
            self._shelf.warn_of_surface(
                Sentence(
                    "3mf-contents",
                    "{file} holds {contents}.",
                    file=self._main,
                    contents=[count_of(count, what) for what, count in odd.items()],
                )
            )
        if self._filaments.is_damaged:
            self._shelf.warn(
                Sentence(
                    "3mf-filaments-damaged", "{file}: the slicer's data of filaments is damaged and left out.", file=self._main
                )
            )
        if self._not_solid.is_damaged:
            self._shelf.warn(
                Sentence("3mf-parts-damaged", "{file}: the slicer's data of parts is damaged and left out.", file=self._main)
            )

    def _check_expansion(self, build_items: list[tuple[str, str]]) -> None:
        """Raises SceneError if nested components expand to too many objects. Called before any object is added."""

        def children(key: tuple[str, str]) -> list[tuple[str, str]]:
            if key == _BUILD:
                return build_items
            found = self._model(key[0]).objects.get(key[1])
            return [] if found is None else [(path, number) for path, number, _ in found.components]

        check_expansion(_BUILD, children, self._main)

    def _root(self) -> str:
        if "_rels/.rels" in self._names:
            for target, kind in relations_of(self._bytes("_rels/.rels")):
                if kind.endswith("/3dmodel"):
                    return target
        found = [name for name in self._names if name.endswith(".model")]
        if not found:
            raise SceneError(Sentence("3mf-model-missing", "{file} contains no model; export the file again", file=self._main))
        return min(found, key=len)

    def _bytes(self, path: str) -> bytes:
        name = self._names.get(path.lower().lstrip("/"))
        if name is None:
            raise SceneError(
                Sentence(
                    "3mf-part-missing",
                    "{file}: its part {path} is missing; export the file again",
                    file=self._main,
                    path=path[:120],
                )
            )
        entry = self._package.getinfo(name)
        if entry.file_size > MAX_PART_BYTES:
            raise SceneError(
                Sentence(
                    "3mf-part-too-large",
                    "{file}: its part {path} is larger than {most_gib} GiB; make it smaller",
                    file=self._main,
                    path=path[:120],
                    most_gib=MAX_PART_BYTES >> 30,
                )
            )
        if is_bomb(entry.file_size, entry.compress_size):
            times = entry.file_size // max(entry.compress_size, 1)
            raise SceneError(
                Sentence(
                    "3mf-part-zip-bomb",
                    "{file}: its part {path} unpacks to {ratio} times its size, as zip bombs do; pack it again",
                    file=self._main,
                    path=path[:120],
                    ratio=times,
                )
            )
        try:
            return self._package.read(name)
        except (*DAMAGED, OSError) as error:
            raise SceneError(
                Sentence(
                    "3mf-part-damaged",
                    "{file}: its part {path} is damaged ({error}); export it again",
                    file=self._main,
                    path=path[:120],
                    error=library_message(error),
                )
            ) from error

    def _model(self, path: str) -> _Model:
        key = path.lower().lstrip("/")
        if key not in self._models:
            self._models[key] = _Model(self._bytes(path), path, self._main)
        return self._models[key]

    def _add_object(
        self, path: str, number: str, place: F64, depth: int, color: str | None = None, parent: str | None = None
    ) -> None:
        """Adds an object and its components to the description, at a transform.

        color: filament colour of the containing object; parent: id of the containing object.
        """
        color = (self._filaments.parts if depth else self._filaments.objects).get(number, color)
        model = self._model(path)
        found = model.objects.get(number)
        if found is None or depth > 64:
            raise SceneError(
                Sentence(
                    "3mf-object-missing",
                    "{file} refers to object {number}, which does not exist; export it again",
                    file=self._main,
                    number=number[:20],
                )
                if found is None
                else Sentence(
                    "3mf-components-too-deep", "{file}: its components contain each other; export it again", file=self._main
                )
            )
        if self._not_solid.is_left_out(number, parent, found.type, found.true):
            return
        for below, other, within in found.components:
            self._add_object(below, other, product(place, within), depth + 1, color, number)
        if found.triangles or any("v1" in rows.columns for rows in found.rows):
            key = path.lower().lstrip("/"), number, color
            if key not in self._made:
                plain = Material() if color is None else Material("filament", base_color=_linear(_color(color) or _WHITE))
                self._made[key] = list(self._meshes(model, found, number, self._material(color, plain)))
            name = found.name or f"object {number}"
            self._description.instances += [Instance(mesh, place, name=name) for mesh in self._made[key]]
            if len(self._description.instances) > MAX_INSTANCES:
                raise SceneError(
                    Sentence(
                        "3mf-objects-too-many",
                        "{file} places more than {most} objects; reduce them",
                        file=self._main,
                        most=MAX_INSTANCES,
                    )
                )

    def _meshes(self, model: _Model, item: _Object, number: str, plain: int) -> Iterator[int]:
        """Adds the meshes of an object, one per material, and yields their indices.

        plain: index of the material for triangles without a material.
        """
        points, corners = item.points, item.corners
        if corners.min() < 0 or corners.max() >= len(points):
            raise SceneError(
                Sentence(
                    "3mf-vertex-out-of-range",
                    "{file}: a triangle refers to vertex {vertex}, but there are {count}; export it again",
                    file=self._main,
                    vertex=corners.max(),
                    count=len(points),
                )
            )
        group, names = item.group_of
        title, chosen = item.name or f"object {number}", item.corner_properties
        if (solid := self._not_solid.is_solid(number, len(corners))) is not None:
            corners, group, chosen = corners[solid], group[solid], chosen[solid]
        if not len(corners):
            return
        for i, name in enumerate(names):
            if name and name not in model.groups:
                self._odd[
                    Sentence("3mf-triangle-properties-missing", "triangles whose properties (pid) are not in the file")
                ] += int((group == i).sum())
        if all(name not in model.groups for name in names):
            yield self._add_mesh(title, points, corners, None, None, plain)
            return
        for i, rows in _indices_by_value(group):
            said = model.groups.get(names[i])
            yield from self._meshes_of_group(model, said, title, points, corners[rows], chosen[rows], plain)

    def _meshes_of_group(
        self,
        model: _Model,
        group: _Group | None,
        name: str,
        points: F32,
        corners: npt.NDArray[Any],
        chosen: npt.NDArray[Any],
        plain: int,
    ) -> Iterator[int]:
        count = 0 if group is None else len(group.values)
        if group is None or count == 0 or (chosen < 0).all():
            yield self._add_mesh(name, points, corners, None, None, plain)
            return
        if beyond := int((chosen >= count).any(axis=1).sum()):
            self._odd[
                Sentence(
                    "3mf-triangle-property-invalid",
                    "triangles whose property index is out of range, read with the last property of the group",
                )
            ] += beyond
        chosen = np.clip(chosen, 0, count - 1)
        if group.kind == "basematerials":
            for value, rows in _indices_by_value(chosen[:, 0]):
                title, color = group.values[value]
                material = Material(title or "material", base_color=_linear(color))
                if color[3] < 255:
                    material.opacity, material.alpha_mode = color[3] / 255, "blend"
                at = self._material((model.path, "base", id(group), value), material)
                yield self._add_mesh(name, points, corners[rows], None, None, at)
        elif group.kind == "colorgroup":
            colors = vertex_colors(np.array(group.values, np.uint8)[chosen.reshape(-1)])
            material = Material("colours", base_color=(1.0, 1.0, 1.0))
            if colors is not None and (colors[:, 3] < 1).any():
                material.alpha_mode = "blend"
            yield self._add_mesh(name, points, corners, None, colors, self._material(material.alpha_mode, material))
        else:
            uvs = np.array(group.values, np.float32)[chosen.reshape(-1)]
            uvs[:, 1] = 1 - uvs[:, 1]  # 3MF measures v from the lower edge
            yield self._add_mesh(name, points, corners, uvs, None, self._textured(model, group.texture))

    def _textured(self, model: _Model, number: str) -> int:
        path, wrap_s, wrap_t = model.textures.get(number, ("", "repeat", "repeat"))
        material = Material(PurePosixPath(path).stem or "texture", base_color=(1.0, 1.0, 1.0))
        if path.lower().lstrip("/") in self._names:
            image = self._shelf.image_bytes(f"{self._main}: {PurePosixPath(path).name}", self._bytes(path))
            material.base_color_texture = self._shelf.texture(image, wrap_s, wrap_t)
        else:
            self._shelf.warn_of_missing(path or number, self._main)
        return self._material((model.path, "texture", number), material)

    def _material(self, key: Any, material: Material) -> int:
        if key not in self._materials:
            self._description.materials.append(material)
            self._materials[key] = len(self._description.materials) - 1
        return self._materials[key]

    def _add_mesh(
        self, name: str, points: F32, corners: npt.NDArray[Any], uvs: F32 | None, colors: F32 | None, material: int
    ) -> int:
        """Adds a mesh of some triangles, and returns its index.

        corners: (T, 3) vertex indices; uvs and colors: per corner, or None; if given, corners share no vertices.
        """
        if uvs is None and colors is None:
            used, triangles = used_among(corners, len(points))
        else:
            used, triangles = corners.reshape(-1), np.arange(corners.size)
        mesh = Mesh(name, points[used], triangles.reshape(-1, 3).astype(np.int32), None, uvs, material, None, colors)
        self._description.meshes.append(mesh)
        self._surfaces.append(len(self._made))  # the meshes of an object share a surface
        return len(self._description.meshes) - 1


def _indices_by_value(values: npt.NDArray[np.int64]) -> Iterator[tuple[int, npt.NDArray[np.int64]]]:
    """Yields each distinct value, ascending, with the indices at which it occurs in `values`."""
    order = np.argsort(values, kind="stable")
    begins = np.flatnonzero(np.diff(values[order], prepend=values.min(initial=0) - 1))
    for begin, end in pairwise([*begins.tolist(), len(order)]):
        yield int(values[order[begin]]), order[begin:end]


def _linear(color: tuple[int, int, int, int]) -> tuple[float, float, float]:
    found = vertex_colors(np.array([color[:3]], np.uint8))
    r, g, b = (1.0, 1.0, 1.0) if found is None else (float(c) for c in found[0, :3])
    return r, g, b
