"""Stores a compiled scene in one safetensors file, and maps it into memory without copying.

A moving scene is stored in parts (compiled_parts.py).
The safetensors format: u64 length of the header, the header (JSON: name -> dtype, shape, offsets), the arrays. The header is
padded so that the arrays start at a multiple of 64 bytes, and are read as views of the mapping: all processes of a machine
share one copy.
"""

from __future__ import annotations

import json
import mmap
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from renderer.arrays.scene import LAYOUT, CompiledScene, check, flat, nested, seal
from renderer.errors import SceneError
from renderer.scene.compiled_parts import MANIFEST_STARTS, Find, load_parts
from renderer.sentences import Sentence

__all__ = ["CompiledScene", "load", "save", "seal"]

_FORMAT = {"format": "rayfarm-scene", "version": "1"}
_DTYPE_NAMES = {"<f4": "F32", "<f8": "F64", "<i4": "I32", "|u1": "U8"}
_ALIGN = 64
_MAX_HEADER = 1 << 20


def save(scene: CompiledScene, path: Path) -> None:
    """Writes the scene to `path` atomically. The same scene yields the same bytes."""
    header: dict[str, Any] = {"__metadata__": _FORMAT}
    end = 0
    arrays = flat(scene)
    for name, array in arrays.items():
        start, end = end, end + array.nbytes
        header[name] = {"dtype": _DTYPE_NAMES[LAYOUT[name][0]], "shape": list(array.shape), "data_offsets": [start, end]}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-(8 + len(text)) % _ALIGN)
    path = Path(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(len(text).to_bytes(8, "little") + text)
            for array in arrays.values():
                file.write(np.ascontiguousarray(array).data)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def load(path: Path, find: Find | None = None) -> CompiledScene:
    """Loads a scene written by `save`, or by renderer.scene.compiled_parts.Saver, as read-only views of the files.

    find: returns the path of a part that a manifest lists; None: the parts are in the manifest's folder.

    Raises SceneError if the file is damaged, truncated, or not a compiled scene; OSError if it cannot be opened.
    """
    path = Path(path)
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if file.read(1) == MANIFEST_STARTS:
            file.seek(0)
            return _of_parts(path, file.read(), find)
        if size < 8:
            raise SceneError(
                Sentence(
                    "compiled-scene-too-short",
                    "{name} is not a compiled scene: it has only {size} bytes",
                    name=path.name,
                    size=size,
                )
            )
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    try:
        return nested(_views(mapped, size))
    except SceneError as error:
        raise SceneError(
            Sentence(
                "compiled-scene-damaged",
                "{name} is damaged or not a compiled scene: {error}. Prepare the scene again",
                name=path.name,
                error=error,
            )
        ) from error


def _of_parts(path: Path, manifest: bytes, find: Find | None) -> CompiledScene:
    try:
        return load_parts(manifest, find or (lambda sha256, size: path.parent / sha256))
    except SceneError as error:
        raise SceneError(
            Sentence(
                "compiled-scene-damaged",
                "{name} is damaged or not a compiled scene: {error}. Prepare the scene again",
                name=path.name,
                error=error,
            )
        ) from error


def _views(mapped: mmap.mmap, size: int) -> dict[str, Any]:
    """Returns the arrays of the mapped file as views, by name, after checking their types and shapes.

    size: of the file in bytes. Raises SceneError if the file's header is damaged or was written by another version.
    """
    length = int.from_bytes(mapped[:8], "little")
    if not 2 <= length <= min(_MAX_HEADER, size - 8):
        raise SceneError(Sentence("compiled-header-length-wrong", "its header's length is wrong"))
    try:
        header = json.loads(mapped[8 : 8 + length])
        if header.pop("__metadata__") != _FORMAT:
            raise SceneError(Sentence("compiled-version-mismatch", "it was written by another version"))
        if list(header) != list(LAYOUT):
            raise SceneError(Sentence("compiled-array-list-wrong", "its list of arrays is not the expected one"))
        arrays = {}
        end = 0
        for name, (dtype, _) in LAYOUT.items():
            entry = header[name]
            shape = tuple(int(n) for n in entry["shape"])
            start, stop = entry["data_offsets"]
            count = int(np.prod(shape, dtype=object)) if shape else 1
            if (
                entry["dtype"] != _DTYPE_NAMES[dtype]
                or start != end
                or min(shape) < 0
                or stop - start != count * np.dtype(dtype).itemsize
            ):
                raise SceneError(Sentence("compiled-array-entry-wrong", "the entry of {name} is wrong", name=name))
            end = stop
            if 8 + length + stop > size:
                raise SceneError(Sentence("compiled-file-cut-off", "it ends before {name}", name=name))
            arrays[name] = np.frombuffer(mapped, dtype, count, 8 + length + start).reshape(shape)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SceneError(Sentence("compiled-header-unreadable", "its header cannot be read")) from error
    if 8 + length + end != size:
        raise SceneError(Sentence("compiled-file-too-long", "it is longer than the sum of its arrays"))
    check(arrays)
    return arrays
