"""Generates a GLB for browser tests: a red cube on a white floor under a lamp."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

__all__ = ["small_glb"]

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
QUAD = np.array([0, 1, 2, 0, 2, 3], np.uint16)


def cube() -> tuple[np.ndarray, np.ndarray]:
    """Returns (positions, triangles) of the cube from -1 to 1, facing outwards."""
    positions, triangles = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.insert(CORNERS[:: int(side)] if axis != 1 else CORNERS[:: -int(side)], axis, side, axis=1)
            triangles.append(QUAD + 4 * len(positions))
            positions.append(face)
    return np.concatenate(positions).astype("<f4"), np.concatenate(triangles).astype("<u2")


def floor(height: float, size: float, down: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Returns (positions, triangles) of a horizontal square that faces up or down."""
    positions = np.insert(CORNERS * size, 1, height, axis=1).astype("<f4")
    return positions, (QUAD if down else QUAD[::-1]).astype("<u2")


def small_glb(test: str) -> bytes:
    """Returns a GLB of three meshes and a camera, as bytes.

    test: name of the test, stored in the file. A file that another test has uploaded to the same farm would be known there
    under that test's name and with that test's preview.
    """
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 8}}  # parts of the picture are brighter than 1
    parts = [
        (*cube(), {"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.1, 0.08, 1], "metallicFactor": 0}}),
        (*floor(-1.001, 6.0), {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0}}),
        (*floor(2.6, 1.5, down=True), {"emissiveFactor": [1, 0.9, 0.7], "doubleSided": True, "extensions": strength}),
    ]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": test},
        "scene": 0,
        "accessors": [],
        "bufferViews": [],
        "meshes": [],
    }
    document["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    document["materials"] = [material for *_, material in parts]
    blob = b""
    for positions, triangles, _ in parts:
        for array, kind, component in ((positions, "VEC3", 5126), (triangles, "SCALAR", 5123)):
            document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
            accessor = {
                "bufferView": len(document["accessors"]),
                "componentType": component,
                "count": len(array),
                "type": kind,
            }
            if kind == "VEC3":
                accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
            document["accessors"].append(accessor)
            blob += array.tobytes() + b"\0" * (-array.nbytes % 4)
        at = len(document["accessors"])
        primitive = {"attributes": {"POSITION": at - 2}, "indices": at - 1, "material": len(document["meshes"])}
        document["meshes"].append({"primitives": [primitive]})
    document["buffers"] = [{"byteLength": len(blob)}]
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    document["nodes"] = [{"mesh": i} for i in range(len(parts))] + [{"camera": 0, "translation": [0, 0.5, 8], "name": "Front"}]
    document["scenes"] = [{"nodes": list(range(len(parts) + 1))}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
