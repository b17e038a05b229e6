"""Reads Mitsuba's own mesh format .serialized, versions 3 and 4. Source: Mitsuba 3's documentation, plugin "serialized"."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import Mesh
from renderer.scene.origin import in_exact_type
from renderer.sentences import Sentence

__all__ = ["read_serialized"]

_MAGIC = 0x041C
_NORMALS, _UVS, _COLORS, _FACE_NORMALS, _SINGLE, _DOUBLE = 0x1, 0x2, 0x8, 0x10, 0x1000, 0x2000
_MAX_UNPACKED = 4 << 30


def read_serialized(data: bytes, name: str, index: int) -> Mesh:
    """Returns the mesh with this index in the file. Raises SceneError if the file is damaged or has fewer meshes."""
    damaged = SceneError(
        Sentence("mitsuba-serialized-damaged", "{name} is damaged, or not a Mitsuba mesh file; export it again", name=name)
    )
    try:
        magic, version = struct.unpack_from("<HH", data, 0)
        count = struct.unpack_from("<I", data, len(data) - 4)[0]
        if magic != _MAGIC or version not in (3, 4):
            raise damaged
        if not 0 <= index < count:
            raise SceneError(
                Sentence(
                    "mitsuba-serialized-mesh-missing",
                    "{name} has {count} meshes, but none with the number {index}",
                    name=name,
                    count=count,
                    index=index,
                )
            )
        width, form = (8, "<Q") if version == 4 else (4, "<I")
        table = len(data) - 4 - width * count
        if table < 0:
            raise damaged
        (begin,) = struct.unpack_from(form, data, table + width * index)
        body = _unpacked(data[begin + 4 : table], damaged)
        return _mesh(body, version, f"{name} {index}", damaged)
    except (struct.error, zlib.error, ValueError):
        raise damaged from None


def _unpacked(packed: bytes, damaged: SceneError) -> bytes:
    unpacker = zlib.decompressobj()
    body = unpacker.decompress(packed, _MAX_UNPACKED)
    if unpacker.unconsumed_tail:
        raise damaged
    return body


def _mesh(body: bytes, version: int, name: str, damaged: SceneError) -> Mesh:
    (flags,) = struct.unpack_from("<I", body, 0)
    at = 4
    if version == 4:
        end = body.index(b"\0", at)
        name, at = body[at:end].decode("utf-8", "replace") or name, end + 1
    vertices, triangles = struct.unpack_from("<QQ", body, at)
    at += 16
    kind = np.dtype("<f8" if flags & _DOUBLE else "<f4")
    if (vertices * 3 * kind.itemsize) + triangles * 12 > len(body) - at or not vertices or not triangles:
        raise damaged

    def next_rows(width: int) -> npt.NDArray[Any]:
        nonlocal at
        found = np.frombuffer(body, kind, vertices * width, at).reshape(-1, width)
        at += vertices * width * kind.itemsize
        return found

    positions = in_exact_type(next_rows(3))
    normals = next_rows(3).astype(np.float32) if flags & _NORMALS else None
    uvs = next_rows(2).astype(np.float32) if flags & _UVS else None
    colors = next_rows(3).astype(np.float32) if flags & _COLORS else None
    wide = np.dtype("<u8" if vertices > 0xFFFFFFFF else "<u4")
    corners = np.frombuffer(body, wide, triangles * 3, at).reshape(-1, 3)
    if corners.max() >= vertices:
        raise damaged
    rgba = None if colors is None else np.column_stack([colors, np.ones(len(colors), np.float32)])
    if flags & _FACE_NORMALS:
        normals = None
    return Mesh(name, positions, corners.astype(np.int32), normals, uvs, colors=rgba)
