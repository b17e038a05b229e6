"""Reads STL files: triangles, with colours where a program stores these in the two attribute bytes."""

from __future__ import annotations

from importlib import import_module
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import Instance, Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.polygon_meshes import triangulated
from renderer.scene.readers.up_axis import Z_UP
from renderer.scene.text_encoding import as_utf8, decoded, readable, with_decimal_points
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read"]

_HEAD = 84
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("color", "<u2")])
_OWN = 1 << 15


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's triangles to the description. Raises SceneError if the file is damaged."""
    data = files.read(main)
    if len(data) != _HEAD + _ROW.itemsize * int.from_bytes(data[80:_HEAD], "little"):
        data = as_utf8(data)
    count = _triangles_of(data, main)
    shelf = TextureShelf(description, files)
    if count is None:
        text, commas = with_decimal_points(readable(decoded(data)))  # the parser fails on non-ASCII names
        if commas:
            shelf.warn(
                Sentence(
                    "mesh-decimal-commas",
                    "{file}: {count} numbers have decimal commas, which are read as points.",
                    file=main,
                    count=commas,
                )
            )
        data = "\n".join(text.splitlines()).encode()
        import_module("renderer.scene.readers.trimesh_files").read_data(data, ".stl", files, main, description)  # heavy
        return
    rows = np.frombuffer(data, _ROW, count, _HEAD)
    corners = np.ascontiguousarray(rows["corners"]).reshape(-1, 3)
    colors = _colors(rows["color"], data[:80])
    if colors is None and (odd := int(np.count_nonzero(rows["color"]))):
        shelf.warn_of_surface(
            Sentence(
                "stl-attributes-not-colours",
                "{file}: {count} of {total} triangles have attributes that are not colours; they are left out.",
                file=main,
                count=odd,
                total=count,
            )
        )
    whole = triangulated(np.full(count, 3), np.arange(3 * count), corners, main, shelf).face
    if len(whole) < count:
        corners = corners.reshape(-1, 9)[whole].reshape(-1, 3)
        colors = None if colors is None else colors[whole]
    corners += np.float32(0)  # turns -0 into 0
    first, number = unique_threes(corners)
    if colors is not None:
        code = np.repeat(colors.view(np.int32).reshape(-1), 3)
        first, number = unique_threes(np.column_stack([number, code, np.zeros_like(code)]))
    mesh = Mesh(PurePosixPath(main).stem, corners[first], number.reshape(-1, 3))
    material = Material()
    if colors is not None:
        mesh.colors, material.base_color = vertex_colors(colors[first // 3]), (1.0, 1.0, 1.0)
    description.materials.append(material)
    mesh.material = len(description.materials) - 1
    description.meshes.append(smoothed(mesh))
    description.instances.append(Instance(len(description.meshes) - 1, Z_UP, name=mesh.name))


def _triangles_of(data: bytes, main: str) -> int | None:
    """Returns the number of triangles in a binary file; None for a text file. Raises SceneError if the file is truncated."""
    said = int.from_bytes(data[80:_HEAD], "little") if len(data) >= _HEAD else 0
    there = max(len(data) - _HEAD, 0) // _ROW.itemsize
    if there and said * _ROW.itemsize == len(data) - _HEAD:
        return there
    if len(data) < _HEAD or (data[:200].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:512]):
        return None
    if said > there:
        raise SceneError(
            Sentence(
                "stl-file-cut-off",
                "{file} has {found} of {declared} triangles; the upload or download was interrupted, repeat it",
                file=main,
                found=there,
                declared=said,
            )
        )
    if there == 0:
        raise SceneError(Sentence("stl-triangles-missing", "{file} has no triangles; export it again", file=main))
    return said or there


def _colors(words: npt.NDArray[np.uint16], head: bytes) -> npt.NDArray[np.uint8] | None:
    """Returns (T, 4) sRGB codes of the triangles; None without colours.

    words: (T,) attribute bytes; head: the file's header. Magics stores the object's colour in the header, and clears the highest
    bit of triangles with their own colour, red in the lowest bits. VisCAM and SolidView set the bit, blue in the lowest bits.
    Other values are ignored.
    """
    at = head.find(b"COLOR=")
    whole = (255, 255, 255, 255)
    if 0 <= at <= len(head) - 10:
        whole = head[at + 6], head[at + 7], head[at + 8], 255
        has, shifts = (words & _OWN) == 0, (0, 5, 10)
    elif (words & _OWN).any() and (((words & _OWN) != 0) | (words == 0)).all():
        has, shifts = (words & _OWN) != 0, (10, 5, 0)
    else:
        return None
    found = np.empty((len(words), 4), np.uint8)
    found[:] = whole
    for k, shift in enumerate(shifts):
        level = ((words[has] >> shift) & 31).astype(np.uint16)
        found[has, k] = (level * 255 + 15) // 31
    return found
