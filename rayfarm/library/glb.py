"""Encodes a mesh given as arrays to a .glb file (glTF 2.0, one primitive), which the renderer and a farm can read."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError

__all__ = ["ATTRIBUTES", "mesh_as_glb"]

_FLOAT, _UINT32 = 5126, 5125
_JSON, _BIN = 0x4E4F534A, 0x004E4942
# Vertex attributes by our names: glTF's name, and the number of components.
ATTRIBUTES = {
    "positions": ("POSITION", (3,)),
    "normals": ("NORMAL", (3,)),
    "uvs": ("TEXCOORD_0", (2,)),
    "uvs1": ("TEXCOORD_1", (2,)),
    "colors": ("COLOR_0", (3, 4)),
}


def mesh_as_glb(name: str, arrays: Mapping[str, Any]) -> bytes:
    """Encodes a mesh: positions (V, 3), triangles (T, 3) of integers below V, and optional attributes.

    Attributes: normals (V, 3), uvs and uvs1 (V, 2), colors (V, 3 or 4) linear. name: for error messages. Raises SceneError if an
    array has another shape.
    """
    triangles = np.asarray(arrays.get("triangles"))
    count = len(np.atleast_1d(np.asarray(arrays.get("positions"))))
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    blob = bytearray()

    def add(values: npt.NDArray[Any], component: int, kind: str, **more: Any) -> int:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": values.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind, **more})
        blob.extend(values.tobytes())
        return len(accessors) - 1

    attributes = {}
    for ours, (theirs, sizes) in ATTRIBUTES.items():
        if arrays.get(ours) is None:
            if ours == "positions":
                raise SceneError(f"{name}: a mesh of arrays needs positions, (V, 3) numbers")
            continue
        values = _numbers(name, ours, arrays[ours], sizes)
        if len(values) != count:
            raise SceneError(f"{name}: {ours} are of {len(values):,} vertices; the mesh has {count:,} positions")
        ends = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()} if ours == "positions" else {}
        attributes[theirs] = add(values, _FLOAT, f"VEC{values.shape[1]}", **ends)
    if triangles.dtype.kind not in "iu" or triangles.ndim != 2 or triangles.shape[1] != 3 or not len(triangles):
        raise SceneError(f"{name}: triangles are (T, 3) whole numbers, the vertices' places in positions, and at least one")
    if triangles.min() < 0 or triangles.max() >= count:
        raise SceneError(f"{name}: a triangle has a vertex {triangles.max():,}; the mesh has {count:,}, counted from 0")
    indices = add(np.ascontiguousarray(triangles, "<u4").reshape(-1), _UINT32, "SCALAR")
    document = {
        "asset": {"version": "2.0", "generator": "Rayfarm"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": [{"attributes": attributes, "indices": indices}]}],
        "buffers": [{"byteLength": len(blob)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    whole = 12 + 8 + len(head) + 8 + len(blob)
    return b"".join(
        (
            struct.pack("<4sII", b"glTF", 2, whole),
            struct.pack("<II", len(head), _JSON),
            head,
            struct.pack("<II", len(blob), _BIN),
            blob,
        )
    )


def _numbers(name: str, what: str, given: Any, sizes: tuple[int, ...]) -> npt.NDArray[np.float32]:
    try:
        values = np.ascontiguousarray(given, "<f4")
    except (TypeError, ValueError):
        raise SceneError(f"{name}: {what} are not an array of numbers") from None
    if values.ndim != 2 or values.shape[1] not in sizes or not len(values):
        wanted = " or ".join(map(str, sizes))
        raise SceneError(f"{name}: {what} have the shape {values.shape}; they take (V, {wanted})")
    if not np.isfinite(values).all():
        raise SceneError(f"{name}: {what} hold numbers that are not finite")
    return values
