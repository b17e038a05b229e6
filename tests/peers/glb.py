"""Writer for small GLB files from NumPy arrays: glTF 2.0's JSON and one binary chunk."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

__all__ = ["Glb"]

_COMPONENT = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121}
_TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Glb:
    """Builder of a GLB file. Every `add_...` method returns the index of the new element."""

    def __init__(self) -> None:
        self.root: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}
        self._bytes = bytearray()

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Adds an item to the top-level list `kind` of the glTF document, and returns its index."""
        self.root.setdefault(kind, []).append(item)
        return len(self.root[kind]) - 1

    def use(self, extension: str) -> None:
        """Lists an extension in extensionsUsed."""
        used = self.root.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def add_view(self, data: bytes) -> int:
        """Adds a buffer view of these bytes, and returns its index."""
        self._bytes += b"\0" * (-len(self._bytes) % 4)
        self._bytes += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": len(self._bytes) - len(data), "byteLength": len(data)})

    def add_accessor(self, values: np.ndarray) -> int:
        """Adds an accessor of values (n,) or (n, 2..4), and returns its index."""
        columns = 1 if values.ndim == 1 else values.shape[1]
        accessor = {
            "bufferView": self.add_view(np.ascontiguousarray(values).tobytes()),
            "componentType": _COMPONENT[str(values.dtype)],
            "count": len(values),
            "type": _TYPE[columns],
        }
        if columns == 3:
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self.add("accessors", accessor)

    def add_mesh(self, attributes: dict[str, np.ndarray], triangles: np.ndarray, material: int) -> int:
        """Adds a mesh, and returns its index. attributes: by glTF's names (POSITION, NORMAL, TEXCOORD_0 ...)."""
        primitive = {
            "attributes": {name: self.add_accessor(values.astype(np.float32)) for name, values in attributes.items()},
            "indices": self.add_accessor(triangles.astype(np.uint32).reshape(-1)),
            "material": material,
        }
        return self.add("meshes", {"primitives": [primitive]})

    def add_node(self, **node: Any) -> int:
        """Adds a node to the scene, and returns its index."""
        index = self.add("nodes", node)
        self.root["scenes"][0]["nodes"].append(index)
        return index

    def add_texture(self, pixels: np.ndarray) -> int:
        """Adds a repeating texture of pixels (h, w, 3 or 4) uint8, and returns its index."""
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, "PNG")
        image = self.add("images", {"bufferView": self.add_view(buffer.getvalue()), "mimeType": "image/png"})
        return self.add("textures", {"source": image})

    def add_light(self, light: dict[str, Any], **node: Any) -> None:
        """Adds a node with a punctual light, which emits along -Z."""
        self.use("KHR_lights_punctual")
        lights = self.root.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(light)
        self.add_node(extensions={"KHR_lights_punctual": {"light": len(lights) - 1}}, **node)

    def save(self, path: Path) -> Path:
        """Writes the file, and returns its path."""
        self.root["buffers"] = [{"byteLength": len(self._bytes)}]
        chunks = [(0x4E4F534A, json.dumps(self.root).encode(), b" "), (0x004E4942, bytes(self._bytes), b"\0")]
        body = b""
        for kind, data, pad in chunks:
            data += pad * (-len(data) % 4)
            body += struct.pack("<II", len(data), kind) + data
        path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)
        return path
