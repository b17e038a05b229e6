"""Packet of a scene's preview mesh, which the page draws until the path tracer has samples. Little-endian."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from protocol.layout import U16, U32, Layout

__all__ = ["MESH", "Mesh", "MeshHead", "decode_mesh", "encode_mesh"]

STEPS = (1 << 16) - 1  # of a coordinate between the bounds
BOUNDS = 6  # f64
VERTEX = 16  # bytes


class MeshHead(NamedTuple):
    """The head of a preview mesh.

    Six f64 follow: the lower and the upper corner of the mesh's bounding box. Then, for all vertices, positions as four u16 (x,
    y, z between the corners, in units of 1 / 65535, and 0), normals as four i8 (in units of 1 / 127, and 0; all 0: flat shading),
    and colours as four u8 (sRGB, and 255; 0: drawn unshaded). Then three u32 for every triangle.
    """

    background: Annotated[int, U16, "the world's sRGB colour, 5 bits each from the highest, and 1; 0: the studio, or not known"]
    vertices: Annotated[int, U32, "number of vertices"]
    triangles: Annotated[int, U32, "number of triangles"]


MESH = Layout("preview mesh", MeshHead, version=1, kind=4)


class Mesh(NamedTuple):
    """A preview mesh in world space, with V vertices and T triangles.

    normals: unit vectors, or 0 for flat shading. colors: sRGB, and a fourth value: 255, or 0 for vertices drawn unshaded.
    background: of the world behind the scene, sRGB, in steps of 8; None: the studio, which then lights the scene, or not known.
    """

    positions: npt.NDArray[np.float64]  # (V, 3)
    normals: npt.NDArray[np.float32]  # (V, 3)
    colors: npt.NDArray[np.uint8]  # (V, 4)
    triangles: npt.NDArray[np.uint32]  # (T, 3)
    background: tuple[int, int, int] | None = None


def encode_mesh(mesh: Mesh) -> bytes:
    """Encodes a mesh as a packet. It must have at least one vertex."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    shares = (mesh.positions - low) / np.where(high > low, high - low, 1.0)
    count = len(mesh.positions)
    return b"".join(
        [
            MESH.pack(MeshHead(_packed(mesh.background), count, len(mesh.triangles))),
            np.concatenate([low, high]).astype("<f8").tobytes(),
            _padded(np.rint(shares * STEPS), "<u2"),
            _padded(np.rint(mesh.normals * 127.0), "i1"),
            mesh.colors.astype(np.uint8).tobytes(),
            mesh.triangles.astype("<u4").tobytes(),
        ]
    )


def decode_mesh(packet: bytes) -> Mesh:
    """Decodes a mesh packet. Raises ValueError if it is malformed."""
    head = MESH.unpack(packet)
    at, count = MESH.size + 8 * BOUNDS, head.vertices
    if len(packet) != at + VERTEX * count + 12 * head.triangles:
        raise ValueError(f"a mesh of {count} vertices and {head.triangles} triangles has {len(packet)} bytes")
    low, high = np.frombuffer(packet, "<f8", BOUNDS, MESH.size).reshape(2, 3)
    shares = np.frombuffer(packet, "<u2", 4 * count, at).reshape(count, 4)[:, :3] / STEPS
    normals = np.frombuffer(packet, "i1", 4 * count, at + 8 * count).reshape(count, 4)[:, :3] / np.float32(127.0)
    colors = np.frombuffer(packet, "u1", 4 * count, at + 12 * count).reshape(count, 4)
    triangles = np.frombuffer(packet, "<u4", 3 * head.triangles, at + VERTEX * count).reshape(-1, 3)
    red, green, blue = ((head.background >> shift & 31) << 3 for shift in (11, 6, 1))
    background = (red, green, blue) if head.background else None
    return Mesh(low + shares * (high - low), normals.astype(np.float32), colors, triangles, background)


def _packed(background: tuple[int, int, int] | None) -> int:
    if background is None:
        return 0
    red, green, blue = (value >> 3 for value in background)
    return red << 11 | green << 6 | blue << 1 | 1


def _padded(values: npt.NDArray[Any], kind: str) -> bytes:
    """Returns the bytes of values of shape (V, 3), each row padded with a fourth value 0. kind: the dtype of the values."""
    return np.pad(values.astype(kind), ((0, 0), (0, 1))).tobytes()
