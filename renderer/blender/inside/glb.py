"""Edits a GLB file written by Blender's glTF exporter."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

__all__ = ["Glb"]

_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942


class Glb:
    """A GLB file in memory. document: its JSON. Raises ValueError if the file is invalid."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, _, _ = _HEAD.unpack_from(data)
        length, kind = _CHUNK.unpack_from(data, _HEAD.size)
        if magic != b"glTF" or kind != _JSON:
            raise ValueError(f"{path.name} is not a GLB")
        start = _HEAD.size + _CHUNK.size
        self.document: dict[str, Any] = json.loads(data[start : start + length])
        self._parts: list[Any] = []
        self._size = 0
        at = start + length
        if len(data) > at:
            size, _ = _CHUNK.unpack_from(data, at)
            self._append_padded(memoryview(data)[at + _CHUNK.size : at + _CHUNK.size + size])

    def array(self, values: Any, shape: str, component: int, is_bounded: bool = False) -> int:
        """Adds the values of a numpy array as a glTF accessor; returns the accessor's number.

        component: glTF's component type. is_bounded: adds the array's minimum and maximum.
        """
        import numpy as np

        flat = np.ascontiguousarray(values, np.uint32 if component == 5125 else np.float32)
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": flat.nbytes}
        self._append_padded(flat.data.cast("B") if flat.nbytes else b"")
        said: dict[str, Any] = {"componentType": component, "count": len(flat), "type": shape}
        if is_bounded and len(flat):
            said |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        said["bufferView"] = self._add("bufferViews", view)
        return self._add("accessors", said)

    def image(self, png: bytes) -> int:
        """Adds a PNG file as an image; returns the image's number."""
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(png)}
        self._append_padded(png)
        return self._add("images", {"bufferView": self._add("bufferViews", view), "mimeType": "image/png"})

    def texture(self, image: int, like: int) -> int:
        """Adds a texture with an image and the sampler of another texture; returns the texture's number."""
        return self._add("textures", {**self.document["textures"][like], "source": image})

    def write(self, path: Path) -> None:
        """Writes the file atomically."""
        if self._size:
            buffers = self.document.setdefault("buffers", [{}])
            buffers[0]["byteLength"] = self._size
        text = json.dumps(self.document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        total = _HEAD.size + _CHUNK.size + len(text) + (_CHUNK.size + self._size if self._size else 0)
        with path.open("wb") as file:
            file.write(_HEAD.pack(b"glTF", 2, total) + _CHUNK.pack(len(text), _JSON) + text)
            if self._size:
                file.write(_CHUNK.pack(self._size, _BIN))
                for part in self._parts:
                    file.write(part)

    def _append_padded(self, part: Any) -> None:
        """Appends bytes to the binary chunk, padded to a multiple of four."""
        rest = bytes(-len(part) % 4)
        self._parts += [part, rest]
        self._size += len(part) + len(rest)

    def _add(self, name: str, data: dict[str, Any]) -> int:
        found: list[Any] = self.document.setdefault(name, [])
        found.append(data)
        return len(found) - 1
