"""Reads PLY files: surfaces and point clouds, with the property names that common modelling programs and scanners use."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed_together
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.ply_rows import Element, Lists, elements, textures_of
from renderer.scene.readers.points import add_points
from renderer.scene.readers.polygon_meshes import fractions, of_triangles, triangulated, with_corner_values, without_bad_vertices
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read", "read_data"]

Array = npt.NDArray[Any]

_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty"))
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_LINEAR = ("color_0", "color_1", "color_2")  # as Mitsuba writes them
_SUFFIXES, _COLORED = ("0123", "1234", "xyzw"), "_color"  # suffixes of Mitsuba's attribute columns
_ALPHAS = ("alpha", "diffuse_alpha", "a")
_SPLATS = ("f_dc_0", "f_dc_1", "f_dc_2")  # of 3D Gaussians: the constant term of spherical harmonics
_CONSTANT = 0.28209479177387814
_CORNERS = ("vertex_indices", "vertex_index", "vertex_indexes")
_PICTURE = "texnumber"  # a face's or vertex's index among the TextureFile comments
_FACES, _STRIPS = ("face", "faces"), "tristrips"


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's surface or points to the description. Raises SceneError if the file is damaged."""
    read_data(files.read(main), files, main, description)


def read_data(
    data: bytes, files: SceneFiles, main: str, description: SceneDescription, has_pictures: bool = True, attribute: str = ""
) -> None:
    """Adds the surface or points of a PLY file, given as bytes, to the description. Raises SceneError if the file is damaged.

    main: the file's name. has_pictures: whether to read textures; if not, faces are not divided by their texture. attribute: a
    mesh attribute as named by Mitsuba, vertex_NAME or face_NAME, used as colour in place of the file's colours; a mesh without
    the attribute has no colours.
    """
    shelf = TextureShelf(description, files)
    found = elements(data, main, shelf.warn)
    vertex = next((each for each in found if each.name == "vertex"), None)
    if vertex is None or not vertex.count or any(name not in vertex.columns for name in "xyz"):
        raise SceneError(
            Sentence("ply-vertices-missing", "{file} contains no vertices with x, y and z; export it again", file=main)
        )
    positions = in_exact_type(_positions(vertex))
    faces = _faces(found, positions, main, shelf)
    if faces is None or not len(faces.triangles):
        splats = None if _has_colors(vertex) else _splats(vertex)
        if splats is not None:
            description.up_axis = "-y"  # as photogrammetry's cameras and all viewers of Gaussians have it
        colors = _values_of(vertex) if _has_colors(vertex) else splats
        add_points(positions, colors, np.eye(4), main, description, shelf)
        return
    mesh = _mesh(PurePosixPath(main).stem, positions, vertex, faces, main, shelf, attribute)
    named = textures_of(data) if has_pictures else []
    parts = list[Mesh]()
    for picture, rows in _triangles_by_image(vertex, faces, named, main, shelf):
        part = without_bad_vertices(mesh) if rows is None else of_triangles(mesh, rows)
        description.materials.append(_material(part, picture, main, shelf))
        part.material = len(description.materials) - 1
        parts.append(part)
    for part in smoothed_together(parts, surfaces=[0] * len(parts)):
        description.meshes.append(part)
        description.instances.append(Instance(len(description.meshes) - 1, name=part.name))


def _triangles_by_image(
    vertex: Element, faces: _Faces, named: list[str], main: str, shelf: TextureShelf
) -> list[tuple[str | None, npt.NDArray[np.int64] | None]]:
    """Returns the file's texture images (None: no image), each with the triangles that use it (None: all)."""
    number = None
    if faces.element is not None and _PICTURE in faces.element.columns:
        number = faces.element.columns[_PICTURE].astype(np.int64)[faces.face]
    elif _PICTURE in vertex.columns:
        number = vertex.columns[_PICTURE].astype(np.int64)[faces.triangles[:, 0]]
    if len(named) < 2 or number is None:
        if len(named) > 1:
            shelf.warn_of_surface(
                Sentence(
                    "ply-pictures-several",
                    "{file}: names {count} images but not which faces use them; the first is used.",
                    file=main,
                    count=len(named),
                )
            )
        return [(next(iter(named), None), None)]
    lost = (number < 0) | (number >= len(named))
    if lost.any():
        shelf.warn_of_surface(
            Sentence(
                "ply-triangle-picture-invalid",
                "{file}: {count} triangles refer to an image that is not among its {pictures}; they have none.",
                file=main,
                count=lost.sum(),
                pictures=len(named),
            )
        )
    found: list[tuple[str | None, npt.NDArray[np.int64] | None]] = [
        (name, np.flatnonzero(number == i)) for i, name in enumerate(named) if (number == i).any()
    ]
    return [*found, *([(None, np.flatnonzero(lost))] if lost.any() else [])]


def _positions(vertex: Element) -> Array:
    """Returns (V, 3) positions, in float32 if all columns are float32, otherwise in float64."""
    columns = [vertex.columns[name] for name in "xyz"]
    kind = np.float32 if all(column.dtype == np.float32 for column in columns) else np.float64
    return np.stack([column.astype(kind) for column in columns], axis=1)


class _Faces:
    """The triangles of a file, with the element and the lists that they were read from.

    triangles: (T, 3) vertex indices; corners: (T, 3) for each corner, its index in the values of `lists`; face: (T,) for each
    triangle, its row of `element`.
    """

    def __init__(self, lists: Lists, element: Element | None, triangles: Array, corners: Array, face: Array) -> None:
        self.lists, self.element, self.triangles, self.corners, self.face = lists, element, triangles, corners, face


def _faces(found: Iterable[Element], positions: F32, main: str, shelf: TextureShelf) -> _Faces | None:
    for element in found:
        lists = next((element.lists[name] for name in _CORNERS if name in element.lists), None)
        if lists is None or not element.count:
            continue
        if not np.isfinite(lists.values).all():
            raise SceneError(
                Sentence(
                    "ply-face-index-not-integer",
                    "{file}: a face has an index that is not an integer; export the file again",
                    file=main,
                )
            )
        if element.name in _FACES:
            return _polygons(lists, element, positions, main, shelf)
        if element.name == _STRIPS:
            return _strips(lists, positions, main, shelf)
    return None


def _polygons(lists: Lists, element: Element, positions: F32, main: str, shelf: TextureShelf) -> _Faces:
    values = lists.values.astype(np.int64)
    cut = triangulated(lists.count, values, positions, main, shelf)
    return _Faces(lists, element, values[cut.triangles], cut.triangles, cut.face)


def _strips(lists: Lists, positions: F32, main: str, shelf: TextureShelf) -> _Faces:
    """Returns the triangles of triangle strips, every second one with reversed winding.

    A strip ends at -1 or at the end of a row.
    """
    values = lists.values.astype(np.int64)
    ends = np.zeros(len(values) + 1, bool)
    ends[lists.offsets] = True
    begins = np.maximum.accumulate(np.where(ends[:-1] | np.concatenate([[False], values[:-1] < 0]), np.arange(len(values)), 0))
    at = np.arange(max(len(values) - 2, 0))
    whole = (values[at] >= 0) & (values[at + 1] >= 0) & (values[at + 2] >= 0) & (begins[at + 2] <= at)
    at = at[whole]
    odd = (at - begins[at + 2]) % 2
    corners = np.stack([at, at + 1 + odd, at + 2 - odd], axis=1)
    cut = triangulated(np.full(len(at), 3), values[corners].reshape(-1), positions, main, shelf)
    corners = corners[cut.face]
    return _Faces(lists, None, values[corners], corners, np.zeros(len(corners), np.int64))


def _mesh(name: str, positions: F32, vertex: Element, faces: _Faces, main: str, shelf: TextureShelf, attribute: str = "") -> Mesh:
    triangles = faces.triangles
    mesh = Mesh(name, positions, triangles.astype(np.int32))
    mesh.normals = _stacked(vertex, _NORMALS)
    uvs = _stacked(vertex, _UVS)
    mesh.uvs = None if uvs is None else _flip_v(uvs)
    mesh.colors = _colors(vertex, "vertex", attribute, main, shelf)
    by_face = None if mesh.colors is not None or faces.element is None else _colors(faces.element, "face", attribute, main, shelf)
    corner_colors = None if by_face is None else np.repeat(by_face[faces.face], 3, axis=0)
    wedges = None if faces.element is None else faces.element.lists.get("texcoord")
    corner_uvs = None
    if wedges is not None and (wedges.count == 2 * faces.lists.count).all():
        corner_uvs = _flip_v(wedges.values.reshape(-1, 2).astype(np.float32))[faces.corners.reshape(-1)]
    elif wedges is not None and wedges.count.any():
        shelf.warn_of_surface(
            Sentence(
                "ply-face-uvs-incomplete",
                "{file}: its faces have texture coordinates for only some corners; they are left out.",
                file=main,
            )
        )
    return mesh if corner_uvs is None and corner_colors is None else with_corner_values(mesh, corner_uvs, corner_colors)


def _stacked(element: Element, names: Iterable[tuple[str, ...]]) -> F32 | None:
    """Returns (N, k) columns of an element, for the first tuple in `names` all of whose columns exist; None if there is none."""
    for each in names:
        if all(name in element.columns for name in each):
            return np.stack([element.columns[name].astype(np.float32) for name in each], axis=1)
    return None


def _flip_v(uvs: F32) -> F32:
    """Returns UVs with v measured from the image's upper edge; PLY measures v from the lower edge."""
    return np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)


def _has_colors(element: Element) -> bool:
    return any(all(name in element.columns for name in names) for names in (*_COLORS, _LINEAR))


def _linear_of(element: Element) -> F32 | None:
    """Returns (N, 4) linear colours of an element's rows; None if all are white."""
    values = _values_of(element)
    colors = vertex_colors(values)
    if colors is not None and not any(all(name in element.columns for name in names) for names in _COLORS):
        colors[:, :3] = values[:, :3]
    return colors


def _colors(element: Element, owner: str, attribute: str, main: str, shelf: TextureShelf) -> F32 | None:
    """Returns (N, 4) linear colours of an element's rows; None without colours.

    attribute: as for `read_data`; owner: the prefix, vertex or face, of attributes that belong to this element.
    """
    if not attribute:
        return _linear_of(element) if _has_colors(element) else None
    if not attribute.startswith(f"{owner}_"):
        return None
    wanted = attribute.removeprefix(f"{owner}_").lower()
    if wanted == "color" and _has_colors(element):
        is_float = any(column.dtype.kind == "f" for name, column in element.columns.items() if name in ("red", "r"))
        found = _values_of(element) if is_float else _linear_of(element)  # Mitsuba reads fractions as linear
        return np.ones((element.count, 4), np.float32) if found is None else found
    channels = _channels(element, wanted)
    if channels is None:
        return None
    values = np.column_stack([*(channels * 3)[:3], np.ones(element.count)]).astype(np.float32)
    values[:, :3] /= 1.0 if channels[0].dtype.kind == "f" else np.iinfo(channels[0].dtype).max
    odd = int((~((values >= 0) & (values <= 1)).all(axis=1)).sum())
    if odd:
        shelf.warn_of_surface(
            Sentence(
                "ply-values-clamped",
                "{file}: {count} values of {attribute} are outside of 0 to 1 and clamped.",
                file=main,
                count=odd,
                attribute=attribute[:60],
            )
        )
    return np.clip(np.nan_to_num(values), 0, 1)


def _channels(element: Element, name: str) -> list[Array] | None:
    """Returns the one or three columns of an attribute; None if there are none.

    Columns are named by the attribute and a suffix; attributes with suffixes r, g and b are called NAME_color.
    Source: Mitsuba's PLY reader.
    """
    names = [[f"{name}_{suffix}" for suffix in suffixes] for suffixes in _SUFFIXES]
    if name.endswith(_COLORED):
        names.append([f"{name.removesuffix(_COLORED)}_{suffix}" for suffix in "rgba"])
    for each in names:
        channels = [element.columns[name] for name in each if name in element.columns]
        if each[0] in element.columns:
            return channels if len(channels) in (1, 3) else None
    return None


def _values_of(element: Element) -> F32:
    """Returns (N, 4) colours in 0..1 in the file's encoding: linear for the property names in `_LINEAR`, otherwise sRGB."""
    names = next(names for names in (*_COLORS, _LINEAR) if all(name in element.columns for name in names))
    found = np.ones((element.count, 4), np.float32)
    alpha = next((name for name in _ALPHAS if name in element.columns), None)
    for k, name in enumerate((*names, alpha)):
        if name is not None:
            found[:, k] = fractions(element.columns[name])
    if not found[:, 3].any():  # fully transparent clouds are taken as opaque
        found[:, 3] = 1
    return found


def _splats(vertex: Element) -> npt.NDArray[np.uint8] | None:
    """Returns (V, 3) sRGB codes of 3D Gaussians, from their view-independent term; None if the file has no Gaussians."""
    terms = _stacked(vertex, (_SPLATS,))
    if terms is None:
        return None
    return np.rint(np.clip(0.5 + _CONSTANT * np.nan_to_num(terms), 0, 1) * 255).astype(np.uint8)


def _material(mesh: Mesh, picture: str | None, main: str, shelf: TextureShelf) -> Material:
    material = Material()
    if mesh.uvs is not None and picture:
        material.base_color_texture = shelf.find(picture, main, main)
    if mesh.colors is not None or material.base_color_texture is not None:
        material.base_color = (1.0, 1.0, 1.0)
    if mesh.colors is not None and (mesh.colors[:, 3] < 1).any():
        material.alpha_mode = "blend"
    return material
