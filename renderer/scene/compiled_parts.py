"""Stores a compiled scene as a manifest and parts: files named by the hash of their content.

Parts that several frames of a shot share are stored, sent and mapped once. The manifest is JSON: the parts' hashes and sizes,
and for each array its shape and consecutive pieces (part, offset, bytes). A part consists of pieces, each starting at a page
boundary. An array of several pieces is mapped file by file into one contiguous address range: all processes of a machine share
one copy of each part.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import mmap
import os
import re
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import LAYOUT, CompiledScene, check, flat, nested
from renderer.bvh.layout import INSTANCE, LEAF_KIND, NODE_ROWS, PACKET_ROWS, PAGE, ROW_CHILD, ROW_PRIMITIVE, WIDTH
from renderer.errors import SceneError
from renderer.scene.frame_reuse import PartOffsets
from renderer.sentences import Sentence

__all__ = ["MANIFEST_STARTS", "Find", "Part", "Saver", "load_parts", "parts_of", "save_changed"]

Array = npt.NDArray[Any]
Find = Callable[[str, int], Path]  # returns the path of a part by hash and size

MANIFEST_STARTS = b"{"
_FORMAT = "rayfarm-scene-parts 1"
_MOST_PARTS = 64
_IS_SHA256 = re.compile("[0-9a-f]{64}")
_MOST_SEEN = 10_000  # pieces
_VERTICES = ("position", "normal", "tangent", "uv", "uv1", "color")
_DEFORMED_ARRAYS = ("position", "normal", "tangent")  # the arrays that change in a deforming mesh
_MATERIALS = (
    "material_kind",
    "material_flags",
    "material",
    "material_texture",
    "medium",
    "material_medium",
    "texture",
    "texture_transform",
    "key_texture",
)
_ENVIRONMENT = (
    "environment",
    "environment_marginal",
    "environment_conditional",
    "environment_row_start",
    "environment_column_start",
)
_CUT = ("bvh.node", "bvh.packet", "triangle", *_VERTICES)


class Part(NamedTuple):
    """A file that stores some of a scene's arrays: the SHA-256 of its content, which is also its name, and its size in bytes."""

    sha256: str
    size: int


class Saver:
    """Writes the frames of one shot into a folder: a manifest per frame, and each part once, in a file named by its hash."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[tuple[object, ...], Part]] = {}  # reused parts, with the objects they were made from

    def save(self, scene: CompiledScene, cuts: PartOffsets, folder: Path | None = None) -> Path:
        """Writes the scene's manifest and those parts that are not written yet; returns the manifest's path.

        cuts: where the scene's arrays are divided into parts. folder: where to write; None: the Saver's folder.
        """
        folder = folder or self._folder
        arrays = flat(scene)
        parts: list[Part] = []
        pieces: dict[str, list[tuple[int, int, int]]] = {name: [] for name in LAYOUT}
        for name, slices in _slices(arrays, cuts).items():
            slices = {array: rows for array, rows in slices.items() if rows.size}
            if not slices:
                continue
            heads = cuts.heads.get(name)
            known = self._known.get(name)
            if heads is not None and known is not None and _are_unchanged(known[0], heads):
                part = known[1]
            else:
                part = _write_part(slices, folder)
            if heads is not None:
                self._known[name] = heads, part
            at = 0
            for array, rows in slices.items():
                pieces[array].append((len(parts), at, rows.nbytes))
                at += _rounded_to_page(rows.nbytes)
            parts.append(part)
        return _manifest(arrays, parts, pieces, folder)

    def prune(self, manifest: Path) -> None:
        """Removes from the Saver's folder all files that are neither listed in this manifest nor reusable by a later frame."""
        kept = {manifest.name, *(part.sha256 for part in parts_of(manifest)), *(part.sha256 for _, part in self._known.values())}
        for path in self._folder.iterdir():
            if path.name not in kept:
                path.unlink()


def save_changed(data: bytes, scene: CompiledScene, names: Collection[str], folder: Path) -> Path:
    """Writes the manifest, and the new parts, of a scene of which only the arrays `names` differ from an already stored scene.

    data: the manifest of the stored scene. Writes the same bytes as Saver.save. Returns the new manifest's path. Raises
    SceneError if `data` is damaged.
    """
    parts, known = _read(data)
    arrays = flat(scene)
    pieces = {name: list(pieces) for name, (_, pieces) in known.items()}
    changed = sorted({part for name in names for part, *_ in pieces[name]})
    if any(not pieces[name] or len(pieces[name]) > 1 for name in names):
        raise SceneError(Sentence("compiled-changes-misplaced", "its changes are in no part, or in several"))
    for number in changed:
        inside = sorted((at, name, i) for name in pieces for i, (part, at, _) in enumerate(pieces[name]) if part == number)
        slices: dict[str, Array] = {}
        end = 0
        for _, name, i in inside:
            begin = sum(length for *_, length in pieces[name][:i])
            whole = np.ascontiguousarray(arrays[name]).reshape(-1).view(np.uint8)
            rows = whole if name in names else whole[begin : begin + pieces[name][i][2]]
            slices[name] = rows
            pieces[name][i] = (number, end, rows.nbytes)
            end += _rounded_to_page(rows.nbytes)
        parts[number] = _write_part(slices, folder)
    return _manifest(arrays, parts, pieces, folder)


def _manifest(arrays: dict[str, Array], parts: list[Part], pieces: dict[str, list[tuple[int, int, int]]], folder: Path) -> Path:
    manifest = {
        "format": _FORMAT,
        "parts": [list(part) for part in parts],
        "arrays": {n: {"shape": list(arrays[n].shape), "pieces": pieces[n]} for n in LAYOUT},
    }
    data = json.dumps(manifest, separators=(",", ":")).encode()
    path = folder / hashlib.sha256(data).hexdigest()
    path.write_bytes(data)
    return path


def _write_part(slices: dict[str, Array], folder: Path) -> Part:
    digest, size = hashlib.sha256(), 0
    temporary = folder / ".part"
    with temporary.open("wb") as file:
        for rows in slices.values():
            fill = bytes(_rounded_to_page(size) - size)
            for piece in (fill, np.ascontiguousarray(rows).data.cast("B")):
                digest.update(piece)
                file.write(piece)
                size += len(piece)
    temporary.replace(folder / digest.hexdigest())
    return Part(digest.hexdigest(), size)


def _rounded_to_page(size: int) -> int:
    return -(-size // PAGE) * PAGE


def _are_unchanged(cached: tuple[object, ...], heads: tuple[object, ...]) -> bool:
    return len(cached) == len(heads) and all(
        a is b or (isinstance(a, int) and a == b) for a, b in zip(cached, heads, strict=True)
    )


def _slices(arrays: dict[str, Array], cuts: PartOffsets) -> dict[str, dict[str, Array]]:
    """Divides the scene's arrays into parts: returns part name -> array name -> the rows stored in that part.

    The part "top" contains the top level of the BVH and all arrays that no other part contains.
    """
    parts: dict[str, dict[str, Array]] = {"top": {"bvh.node": arrays["bvh.node"][: cuts.node[1]]}}
    for i, name in enumerate(("still", "bodies", "loose")):
        node, packet = slice(cuts.node[i + 1], cuts.node[i + 2]), slice(cuts.packet[i + 1], cuts.packet[i + 2])
        vertices = slice(cuts.vertex[i], cuts.vertex[i + 1])
        parts[name] = {"bvh.node": arrays["bvh.node"][node], "bvh.packet": arrays["bvh.packet"][packet]}
        parts[name] |= {n: arrays[n][vertices] for n in _VERTICES}
        parts[name]["triangle"] = arrays["triangle"][cuts.triangle[i] : cuts.triangle[i + 1]]
    loose = parts["loose"]
    parts["shape of what is loose"] = {
        n: loose.pop(n) for n in list(loose) if n == "triangle" or (n in _VERTICES and n not in _DEFORMED_ARRAYS)
    }
    parts["lights of triangles"] = {"triangle_light": arrays["triangle_light"]}
    parts["materials"] = {n: arrays[n] for n in _MATERIALS}
    parts["textures"] = {"texel": arrays["texel"]}
    parts["volumes"] = {n: arrays[n] for n in ("voxel", "majorant")}
    parts["emission"] = {"emission": arrays["emission"]}
    parts["environment"] = {n: arrays[n] for n in _ENVIRONMENT}
    elsewhere = {n for part in parts.values() for n in part}
    parts["top"] |= {n: array for n, array in arrays.items() if n not in elsewhere}
    return parts


def parts_of(path: Path) -> list[Part]:
    """Returns the parts that a manifest lists; empty for a scene in one file. Raises SceneError if the manifest is damaged."""
    with path.open("rb") as file:
        if file.read(1) != MANIFEST_STARTS:
            return []
        file.seek(0)
        return _read(file.read())[0]


def load_parts(data: bytes, find: Find) -> CompiledScene:
    """Loads the scene of a manifest (data), as read-only views of its parts' files. find: returns the path of a part's file.

    Raises SceneError if the manifest or a part is damaged; OSError if a file cannot be opened.
    """
    parts, arrays = _read(data)
    files = [find(*part) for part in parts]
    for part, path in zip(parts, files, strict=True):
        if path.stat().st_size != part.size:
            raise SceneError(Sentence("compiled-part-size-wrong", "one of its parts has the wrong size"))
    found: dict[str, Array] = {}
    unchecked: dict[str, Array] = {}
    for name, (dtype, _) in LAYOUT.items():
        shape, pieces = arrays[name]
        size = int(np.prod(shape, dtype=object)) * np.dtype(dtype).itemsize
        if size != sum(length for *_, length in pieces):
            raise SceneError(Sentence("compiled-piece-count-wrong", "the number of pieces of {name} is wrong", name=name))
        found[name] = np.frombuffer(_map_pieces(pieces, parts, files), dtype, size // np.dtype(dtype).itemsize).reshape(shape)
        if name in _CUT and name not in _VERTICES and size:
            unchecked[name] = np.concatenate(list(_extremes_of(name, found[name], parts, pieces)))
    check(found, unchecked)
    return nested(found)


def _read(data: bytes) -> tuple[list[Part], dict[str, tuple[tuple[int, ...], list[tuple[int, int, int]]]]]:
    """Parses a manifest: returns the parts, and each array's shape and pieces."""
    try:
        manifest = json.loads(data)
        if manifest["format"] != _FORMAT:
            raise SceneError(Sentence("compiled-version-mismatch", "it was written by another version"))
        parts = [Part(str(sha256), int(size)) for sha256, size in manifest["parts"]]
        arrays = {}
        for name in LAYOUT:
            entry = manifest["arrays"][name]
            pieces = [(int(part), int(at), int(length)) for part, at, length in entry["pieces"]]
            arrays[name] = tuple(int(n) for n in entry["shape"]), pieces
            for i, (part, at, length) in enumerate(pieces):
                is_inside = 0 <= part < len(parts) and at >= 0 and length > 0 and at + length <= parts[part].size
                if not is_inside or at % PAGE or (length % PAGE and i < len(pieces) - 1):
                    raise SceneError(
                        Sentence("compiled-piece-out-of-range", "a piece of {name} lies outside of its part", name=name)
                    )
            if min(arrays[name][0], default=0) < 0:
                raise SceneError(Sentence("compiled-array-shape-wrong", "the shape of {name} is wrong", name=name))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SceneError(Sentence("compiled-manifest-unreadable", "its manifest cannot be read")) from error
    if len(parts) > _MOST_PARTS or not all(_IS_SHA256.fullmatch(p.sha256) and p.size > 0 for p in parts):
        raise SceneError(Sentence("compiled-part-list-wrong", "its list of parts is wrong"))
    return parts, arrays


def _map_pieces(pieces: list[tuple[int, int, int]], parts: list[Part], files: list[Path]) -> Any:
    """Maps the pieces of an array consecutively into one address range, and returns that as a read-only buffer."""
    if not pieces:
        return bytes(8)
    if len(pieces) == 1 and _maps_over is not None:
        part, at, length = pieces[0]
        with files[part].open("rb") as file:
            return mmap.mmap(file.fileno(), length, access=mmap.ACCESS_READ, offset=at)
    whole = mmap.mmap(-1, sum(_rounded_to_page(length) for *_, length in pieces))
    address = ctypes.addressof(ctypes.c_char.from_buffer(whole))
    begin = 0
    for part, at, length in pieces:
        with files[part].open("rb") as file:
            if _maps_over is None:
                file.seek(at)
                file.readinto(memoryview(whole)[begin : begin + length])
            elif _maps_over(address + begin, length, file.fileno(), at) != address + begin:
                raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        begin += length
    return memoryview(whole).toreadonly()


def _fixed_address_mmap() -> Callable[[int, int, int, int], int] | None:
    """Returns the C library's mmap, which can map at a fixed address; Python's mmap cannot.

    Returns None on systems without it, or with pages larger than those of the parts.
    """
    if mmap.ALLOCATIONGRANULARITY > PAGE or not hasattr(mmap, "MAP_SHARED"):
        return None
    function = ctypes.CDLL(None, use_errno=True).mmap
    function.restype = ctypes.c_void_p
    function.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_int64]
    fixed = 0x10
    return lambda address, length, handle, at: function(address, length, mmap.PROT_READ, mmap.MAP_SHARED | fixed, handle, at)


_maps_over = _fixed_address_mmap()
_seen: dict[tuple[str, str, int, int], Array] = {}


def _extremes_of(name: str, array: Array, parts: list[Part], pieces: list[tuple[int, int, int]]) -> Iterator[Array]:
    """Yields rows with the smallest and largest indices of each piece of an array of indices, for checking their range.

    If these rows are within range, all rows of the piece are. Computed once per piece and process.
    """
    begin = 0
    row = array[:1].nbytes
    for part, at, length in pieces:
        if begin % row or length % row:
            raise SceneError(Sentence("compiled-piece-splits-row", "a piece of {name} ends within a row", name=name))
        rows = array[begin // row : (begin + length) // row]
        key = name, parts[part].sha256, at, length
        if key not in _seen:
            if len(_seen) >= _MOST_SEEN:
                _seen.clear()
            _seen[key] = _extremes(name, rows)
        yield _seen[key]
        begin += length


def _extremes(name: str, rows: Array) -> Array:
    if name == "triangle":
        return np.stack([rows.min(axis=0), rows.max(axis=0)])
    if name == "bvh.packet":
        numbers = rows[:, ROW_PRIMITIVE].view(np.int32)[~np.isnan(rows[:, 0])]
        found = np.full((1, PACKET_ROWS, WIDTH), np.nan, np.float32)
        if numbers.size:
            found[0, 0, :2] = 0
            found[0, ROW_PRIMITIVE].view(np.int32)[:2] = numbers.min(), numbers.max()
        return found
    children = rows[:, ROW_CHILD].view(np.int32)
    leaves = ~children[children < 0]
    found = np.zeros((1, NODE_ROWS, WIDTH), np.float32)
    of_kinds = [int(leaves[(leaves & LEAF_KIND != INSTANCE) == is_packet].max(initial=0)) for is_packet in (True, False)]
    worst = [int(children.max(initial=0)), *(~leaf for leaf in of_kinds if leaf)]
    found[0, ROW_CHILD].view(np.int32)[: len(worst)] = worst
    return found
