"""Packet of a scene's preview mesh, which the page draws until the path tracer has samples. Little-endian."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from protocol.layout import U16, U32, Layout
from renderer.image import rgbe9995
from renderer.preview_mesh import PreviewLamp, PreviewMaterial, PreviewMesh, PreviewPart, PreviewTexture

__all__ = ["MESH", "MeshHead", "decode_light", "decode_mesh", "encode_mesh"]

STEPS = (1 << 16) - 1  # of a coordinate between the bounds
BOUNDS = 6  # f64
VERTEX = 16  # bytes without UVs


class MeshHead(NamedTuple):
    """The head of a preview mesh.

    Six f64 follow: the lower and the upper corner of the mesh's bounding box. Then, for all vertices, positions as four u16 (x,
    y, z between the corners, in units of 1 / 65535, and 0), normals as four i8 (in units of 1 / 127, and 0; all 0: flat shading),
    colours as four u8 (sRGB and opacity), and two f32 for each of the `uvs`. Then three u32 for every triangle. Then the
    environment's RGB9E5 words, rows from the top. Then JSON: the fields of PreviewMesh that are lists of records, where a
    texture has the number of its bytes in place of them. Then the bytes of all textures.
    """

    width: Annotated[int, U16, "columns of the environment's texels"]
    height: Annotated[int, U16, "rows of them; 0: it is black"]
    studio: Annotated[int, U16, "1: the environment is the studio that scenes without lights are given; 0: it is not"]
    vertices: Annotated[int, U32, "number of vertices"]
    triangles: Annotated[int, U32, "number of triangles"]
    uvs: Annotated[int, U32, "number of vertices, or 0 if there are no textures"]
    described: Annotated[int, U32, "number of bytes of the JSON"]


MESH = Layout("preview mesh", MeshHead, version=2, kind=4)


def encode_mesh(mesh: PreviewMesh) -> bytes:
    """Encodes a mesh as a packet. It must have at least one vertex. Environments are stored as RGB9E5."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    shares = (mesh.positions - low) / np.where(high > low, high - low, 1.0)
    count = len(mesh.positions)
    height, width = (0, 0) if mesh.environment is None else mesh.environment.shape[:2]
    described = json.dumps(_described(mesh), separators=(",", ":")).encode()
    uvs = 0 if mesh.uvs is None else count
    return b"".join(
        [
            MESH.pack(MeshHead(width, height, int(mesh.studio), count, len(mesh.triangles), uvs, len(described))),
            np.concatenate([low, high]).astype("<f8").tobytes(),
            _padded(np.rint(shares * STEPS), "<u2"),
            _padded(np.rint(mesh.normals * 127.0), "i1"),
            mesh.colors.astype(np.uint8).tobytes(),
            b"" if mesh.uvs is None else mesh.uvs.astype("<f4").tobytes(),
            mesh.triangles.astype("<u4").tobytes(),
            b"" if mesh.environment is None else rgbe9995.pack(mesh.environment).astype("<u4").tobytes(),
            described,
            *(texture.data for texture in mesh.textures),
        ]
    )


def decode_mesh(packet: bytes) -> PreviewMesh:
    """Decodes a mesh packet. Raises ValueError if it is malformed."""
    head = MESH.unpack(packet)
    count, texels = head.vertices, head.width * head.height
    at = _offsets(head)
    if len(packet) < at[-1]:
        raise ValueError(f"a mesh of {count} vertices and {head.triangles} triangles has {len(packet)} bytes")
    low, high = np.frombuffer(packet, "<f8", BOUNDS, at[0]).reshape(2, 3)
    shares = np.frombuffer(packet, "<u2", 4 * count, at[1]).reshape(count, 4)[:, :3] / STEPS
    normals = np.frombuffer(packet, "i1", 4 * count, at[2]).reshape(count, 4)[:, :3] / np.float32(127.0)
    colors = np.frombuffer(packet, "u1", 4 * count, at[3]).reshape(count, 4)
    uvs = np.frombuffer(packet, "<f4", 2 * head.uvs, at[4]).reshape(-1, 2)
    triangles = np.frombuffer(packet, "<u4", 3 * head.triangles, at[5]).reshape(-1, 3)
    words = np.frombuffer(packet, "<u4", texels, at[6]).reshape(head.height, head.width)
    described = json.loads(packet[at[7] : at[8]])
    textures, start = [], int(at[8])
    for texture in described["textures"]:
        textures.append(PreviewTexture(packet[start : start + texture["bytes"]], **texture["sampler"]))
        start += texture["bytes"]
    if start != len(packet):
        raise ValueError(f"a mesh whose textures end at {start} has {len(packet)} bytes")
    return PreviewMesh(
        low + shares * (high - low),
        normals.astype(np.float32),
        colors,
        triangles,
        uvs if head.uvs else None,
        tuple(PreviewPart(**part) for part in described["parts"]),
        tuple(PreviewMaterial(**_with_tuples(material)) for material in described["materials"]),
        tuple(textures),
        tuple(PreviewLamp(**_with_tuples(lamp)) for lamp in described["lamps"]),
        rgbe9995.unpack(words) if head.height else None,
        bool(head.studio),
    )


def decode_light(chunks: Iterable[bytes]) -> tuple[MeshHead, bytes, list[dict[str, Any]]]:
    """Returns the head of a mesh packet, the words of its environment and its lamps. Raises ValueError if it is malformed.

    chunks: the packet, which is read up to its textures. lamps: the fields of PreviewLamp.
    """
    packet = bytearray()
    end = MESH.size
    for chunk in chunks:
        packet += chunk
        if end == MESH.size <= len(packet):
            end = int(_offsets(MESH.unpack(bytes(packet[:end])))[-1])
        if len(packet) >= end > MESH.size:
            break
    head = MESH.unpack(bytes(packet[: MESH.size]))
    *_, texels, described, end = map(int, _offsets(head))
    if len(packet) < end:
        raise ValueError(f"a mesh of {end} bytes and textures has {len(packet)} bytes")
    return head, bytes(packet[texels:described]), json.loads(packet[described:end])["lamps"]


def _offsets(head: MeshHead) -> npt.NDArray[np.int64]:
    """Returns the offsets of a packet's sections, and of its textures."""
    count, texels = head.vertices, head.width * head.height
    sizes = (8 * BOUNDS, 8 * count, 4 * count, 4 * count, 8 * head.uvs, 12 * head.triangles, 4 * texels, head.described)
    return MESH.size + np.cumsum([0, *sizes])


def _described(mesh: PreviewMesh) -> dict[str, Any]:
    textures = [texture._asdict() for texture in mesh.textures]
    return {
        "parts": [part._asdict() for part in mesh.parts],
        "materials": [material._asdict() for material in mesh.materials],
        "textures": [{"bytes": len(texture.pop("data")), "sampler": texture} for texture in textures],
        "lamps": [lamp._asdict() for lamp in mesh.lamps],
    }


def _with_tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}


def _padded(values: npt.NDArray[Any], kind: str) -> bytes:
    """Returns the bytes of values of shape (V, 3), each row padded with a fourth value 0. kind: the dtype of the values."""
    return np.pad(values.astype(kind), ((0, 0), (0, 1))).tobytes()
