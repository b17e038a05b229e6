"""PLY: surfaces and clouds of points, with the names that modelling programs and scanners give what stands beside positions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.ply_rows import Element, Lists, elements, texture_of
from renderer.scene.readers.points import add_points
from renderer.scene.textures import TextureShelf
from renderer.scene.unique import unique_corners

__all__ = ["read", "read_data"]

Array = npt.NDArray[Any]

_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty"))
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_LINEAR = ("color_0", "color_1", "color_2")  # as Mitsuba writes them
_ALPHAS = ("alpha", "diffuse_alpha", "a")
_SPLATS = ("f_dc_0", "f_dc_1", "f_dc_2")  # of 3D Gaussians: the constant term of spherical harmonics
_CONSTANT = 0.28209479177387814
_CORNERS = ("vertex_indices", "vertex_index", "vertex_indexes")
_FACES, _STRIPS = ("face", "faces"), "tristrips"
_FAR = 1e4  # sizes of the whole from the origin, beyond which numbers of 32 bits show steps


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's surface, or its points, to the description. Raises SceneError."""
    read_data(files.read(main), files, main, description)


def read_data(data: bytes, files: SceneFiles, main: str, description: SceneDescription) -> None:
    """The same of a file's bytes. Raises SceneError."""
    found = elements(data, main)
    vertex = next((each for each in found if each.name == "vertex"), None)
    if vertex is None or not vertex.count or any(name not in vertex.columns for name in "xyz"):
        raise SceneError(f"{main}: holds no vertices with x, y and z; export it again")
    shelf = TextureShelf(description, files)
    positions = _positions(vertex, main, shelf)
    faces = _faces(found, main)
    if faces is None or not len(faces.triangles):
        add_points(positions, _values_of(vertex) if _has(vertex) else _splats(vertex), np.eye(4), main, description, shelf)
        return
    if not np.isfinite(positions).all():
        raise SceneError(f"{main}: holds positions that are not finite numbers; export the file again")
    mesh = _mesh(PurePosixPath(main).stem, positions, vertex, faces, main, shelf)
    description.materials.append(_material(mesh, texture_of(data), main, shelf))
    mesh.material = len(description.materials) - 1
    description.meshes.append(smoothed(mesh))
    description.instances.append(Instance(len(description.meshes) - 1, name=mesh.name))


def _positions(vertex: Element, main: str, shelf: TextureShelf) -> F32:
    """(V, 3). What lies very far away, as surveys do in the coordinates of their country, comes to the origin."""
    columns = [vertex.columns[name] for name in "xyz"]
    if any(column.dtype.itemsize < 8 for column in columns):
        return np.stack([column.astype(np.float32) for column in columns], axis=1)
    whole = np.stack(columns, axis=1).astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        low, high = whole.min(axis=0), whole.max(axis=0)
        middle, size = np.rint((low + high) / 2), float((high - low).max())
        if np.isfinite(middle).all() and np.isfinite(size) and np.abs(middle).max() > max(_FAR * size, 1.0):
            shelf.warn(
                f"{main}: lies so far from the origin that its shape would be lost; it is moved by "
                f"({', '.join(f'{-c:.0f}' for c in middle)})."
            )
            whole -= middle
        return whole.astype(np.float32)


class _Faces:
    """triangles: (T, 3) vertices. corners: (T, 3) which of the lists' numbers they are. face: (T,) of which row each is."""

    def __init__(self, lists: Lists, element: Element | None, triangles: Array, corners: Array, face: Array) -> None:
        self.lists, self.element, self.triangles, self.corners, self.face = lists, element, triangles, corners, face


def _faces(found: Iterable[Element], main: str) -> _Faces | None:
    for element in found:
        lists = next((element.lists[name] for name in _CORNERS if name in element.lists), None)
        if lists is None or not element.count:
            continue
        if not np.isfinite(lists.values).all():
            raise SceneError(f"{main}: a face names a vertex by what is no number; export the file again")
        if element.name in _FACES:
            return _fans(lists, element)
        if element.name == _STRIPS:
            return _strips(lists)
    return None


def _fans(lists: Lists, element: Element) -> _Faces:
    count = np.maximum(lists.count - 2, 0)
    face = np.repeat(np.arange(len(count)), count)
    first = np.repeat(lists.first, count)
    step = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    corners = np.stack([first, first + step + 1, first + step + 2], axis=1)
    return _Faces(lists, element, lists.values[corners].astype(np.int64), corners, face)


def _strips(lists: Lists) -> _Faces:
    """Strips of triangles, every second one turned; -1 ends one, as the row's end does."""
    values = lists.values.astype(np.int64)
    ends = np.zeros(len(values) + 1, bool)
    ends[lists.first] = True
    begins = np.maximum.accumulate(np.where(ends[:-1] | np.concatenate([[False], values[:-1] < 0]), np.arange(len(values)), 0))
    at = np.arange(max(len(values) - 2, 0))
    whole = (values[at] >= 0) & (values[at + 1] >= 0) & (values[at + 2] >= 0) & (begins[at + 2] <= at)
    at = at[whole]
    odd = (at - begins[at + 2]) % 2
    corners = np.stack([at, at + 1 + odd, at + 2 - odd], axis=1)
    return _Faces(lists, None, values[corners], corners, np.zeros(len(at), np.int64))


def _mesh(name: str, positions: F32, vertex: Element, faces: _Faces, main: str, shelf: TextureShelf) -> Mesh:
    triangles = faces.triangles
    if triangles.min() < 0 or triangles.max() >= len(positions):
        odd = triangles.min() if triangles.min() < 0 else triangles.max()
        raise SceneError(f"{main}: a face names vertex {odd} where there are {len(positions)}; export the file again")
    mesh = Mesh(name, positions, triangles.astype(np.int32))
    mesh.normals = _stacked(vertex, _NORMALS)
    uvs = _stacked(vertex, _UVS)
    mesh.uvs = None if uvs is None else _upright(uvs)
    if _has(vertex):
        mesh.colors = _linear_of(vertex)
    wedges = None if faces.element is None else faces.element.lists.get("texcoord")
    if wedges is not None and (wedges.count == 2 * faces.lists.count).all():
        corner_uvs = _upright(wedges.values.reshape(-1, 2).astype(np.float32))[faces.corners.reshape(-1)]
        return _split(mesh, corner_uvs, None)
    if wedges is not None and wedges.count.any():
        shelf.warn_of_surface(f"{main}: its faces have texture coordinates for some corners only; they are left out.")
    if mesh.colors is None and faces.element is not None and _has(faces.element):
        colors = _linear_of(faces.element)
        return mesh if colors is None else _split(mesh, None, np.repeat(colors[faces.face], 3, axis=0))
    return mesh


def _split(mesh: Mesh, uvs: F32 | None, colors: F32 | None) -> Mesh:
    """The mesh with values at the corners of its triangles: those that differ in them share no vertex."""
    corners = mesh.triangles.reshape(-1)
    given = [values for values in (uvs, colors) if values is not None]
    first, kind = unique_corners(corners, len(mesh.positions), given)
    at = corners[first]

    def pick(own: F32 | None, values: F32 | None) -> F32 | None:
        return values[first] if values is not None else None if own is None else own[at]

    triangles: I32 = kind.reshape(-1, 3)
    normals = None if mesh.normals is None else mesh.normals[at]
    return Mesh(mesh.name, mesh.positions[at], triangles, normals, pick(mesh.uvs, uvs), colors=pick(mesh.colors, colors))


def _stacked(element: Element, names: Iterable[tuple[str, ...]]) -> F32 | None:
    """(N, k) the columns of the first of several sets of names that an element has all of."""
    for each in names:
        if all(name in element.columns for name in each):
            return np.stack([element.columns[name].astype(np.float32) for name in each], axis=1)
    return None


def _upright(uvs: F32) -> F32:
    """PLY counts v from the image's lower edge."""
    return np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)


def _has(element: Element) -> bool:
    return any(all(name in element.columns for name in names) for names in (*_COLORS, _LINEAR))


def _linear_of(element: Element) -> F32 | None:
    """(N, 4) the linear colours of rows that have some; None where all are white."""
    values = _values_of(element)
    colors = vertex_colors(values)
    if colors is not None and not any(all(name in element.columns for name in names) for names in _COLORS):
        colors[:, :3] = values[:, :3]
    return colors


def _values_of(element: Element) -> F32:
    """(N, 4) the colours of rows that have some, 0 ... 1, as they are written: sRGB, but for those of `_LINEAR`."""
    names = next(names for names in (*_COLORS, _LINEAR) if all(name in element.columns for name in names))
    found = np.ones((element.count, 4), np.float32)
    alpha = next((name for name in _ALPHAS if name in element.columns), None)
    for k, name in enumerate((*names, alpha)):
        if name is not None:
            found[:, k] = _fractions(element.columns[name])
    if not found[:, 3].any():  # what nobody would see is not what is meant
        found[:, 3] = 1
    return found


def _fractions(values: Array) -> F32:
    """Of a column of bytes; of numbers of 16 bits, by their range; of fractions, up to 1 unless some are larger."""
    if values.dtype.kind != "f":
        most = float(np.iinfo(values.dtype).max) if values.dtype.itemsize == 2 else 255.0
    else:
        most = 255.0 if values.max(initial=0.0) > 1.0 else 1.0
    return np.clip(np.nan_to_num(values.astype(np.float64) / most), 0, 1).astype(np.float32)


def _splats(vertex: Element) -> npt.NDArray[np.uint8] | None:
    """(V, 3) the colours of 3D Gaussians as seen from anywhere."""
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
