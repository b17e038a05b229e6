"""Writer for GLB files with meshes, nodes, skins and animations, as far as the example scripts need."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

__all__ = ["Glb"]

FLOAT, SHORT, BYTE = 5126, 5123, 5121
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
LINEAR, CLAMP_TO_EDGE = 9729, 33071


class Glb:
    """A GLB file under construction: each method adds an item and returns its index; `data` returns the bytes."""

    def __init__(self, generator: str) -> None:
        asset = {"version": "2.0", "generator": generator}
        self.document: dict[str, Any] = {"asset": asset, "scene": 0, "scenes": [{"nodes": []}]}
        self.blob = b""

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Adds an entry to one of the document's lists ("nodes", "materials", ...)."""
        found: list[Any] = self.document.setdefault(kind, [])
        found.append(item)
        return len(found) - 1

    def view(self, data: bytes) -> int:
        """Adds a buffer view of the bytes `data`."""
        at = self.add("bufferViews", {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)})
        self.blob += data + b"\0" * (-len(data) % 4)
        return at

    def accessor(self, values: np.ndarray, component: int = FLOAT, *, normalized: bool = False, bounded: bool = False) -> int:
        """Adds an accessor of numbers, (n,) or (n, width), as float32, uint16 or uint8."""
        array = np.ascontiguousarray(values, {FLOAT: "<f4", SHORT: "<u2", BYTE: "u1"}[component])
        table = array.reshape(len(array), -1)
        item = {"bufferView": self.view(array.tobytes()), "componentType": component, "count": len(array)}
        item["type"] = SHAPES[table.shape[1]]
        if normalized:
            item["normalized"] = True
        if bounded:
            item |= {"min": table.min(0).tolist(), "max": table.max(0).tolist()}
        return self.add("accessors", item)

    def texture(self, png: bytes) -> int:
        """Adds a texture with clamped edges."""
        image = self.add("images", {"bufferView": self.view(png), "mimeType": "image/png"})
        sampler = self.add("samplers", {"wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE, "magFilter": LINEAR})
        return self.add("textures", {"source": image, "sampler": sampler})

    def node(self, parent: int | None = None, **item: Any) -> int:
        """Adds a node, below a parent or at the root."""
        at = self.add("nodes", item)
        above = self.document["scenes"][0] if parent is None else self.document["nodes"][parent]
        above.setdefault("nodes" if parent is None else "children", []).append(at)
        return at

    def animation(self, name: str, times: np.ndarray, tracks: dict[tuple[int, str], np.ndarray]) -> int:
        """Adds an animation.

        times: (k,) seconds; tracks: (k, 3 or 4) by node and path ("rotation", ...), interpolated linearly.
        """
        clock = self.accessor(times, bounded=True)
        samplers = [{"input": clock, "output": self.accessor(keys)} for keys in tracks.values()]
        channels = [{"sampler": i, "target": {"node": node, "path": path}} for i, (node, path) in enumerate(tracks)]
        return self.add("animations", {"name": name, "samplers": samplers, "channels": channels})

    def data(self) -> bytes:
        """Returns the file's bytes."""
        text = json.dumps({**self.document, "buffers": [{"byteLength": len(self.blob)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.blob), b"BIN\0") + self.blob
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
