"""Tests that the page's readers of scene files end soon, and take little memory, whatever a file states about itself."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from collections.abc import Iterator
from threading import Timer
from typing import Any

import pytest

from renderer.formats import SCENE_SUFFIXES
from tests.page.node import Node

SECONDS = 20  # far more than any of these takes, also on a busy machine

READ = """
    const bytes = (data) => Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const files = a.files.map(([path, data]) => ({ path, file: new Blob([bytes(data)]) }));
    const known = await m.meshOf({ files, formats: a.formats });
    return known && known.packet.triangles;"""


@pytest.fixture
def own(program: str) -> Iterator[Node]:
    """Yields a Node.js process that is killed if it takes too long: JavaScript cannot be interrupted otherwise."""
    with Node(program, "en-GB") as node:
        timer = Timer(SECONDS, node.__exit__)
        timer.start()
        yield node
        timer.cancel()


def triangles_of(node: Node, files: dict[str, bytes]) -> Any:
    """Returns the number of triangles that the page shows; None if it leaves the file to the service."""
    sent = [(path, base64.b64encode(data).decode()) for path, data in files.items()]
    return node.call("mesh/upload", READ, {"files": sent, "formats": list(SCENE_SUFFIXES)})


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def ply(elements: str) -> bytes:
    corners = "property float x\nproperty float y\nproperty float z\n"
    face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return f"ply\nformat ascii 1.0\n{elements}\n{corners}{face}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode()


def overlapping_fbx() -> bytes:
    """Returns a file whose nodes end beyond the node around them: each of 15 levels is read eight times as often as the last."""
    head = b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", 7400)
    (levels, nodes, size) = (15, 8, 13)
    last = len(head) + levels * nodes * 2 * size
    data = b""
    for level in range(levels):
        for _ in range(nodes):
            at = len(head) + len(data)
            below = len(head) + (level + 1) * nodes * 2 * size
            data += struct.pack("<3IB", at + 2 * size, 0, 0, 0)
            data += struct.pack("<3IB", last, 0, max(below - at - 2 * size, 0), 0)
    return head + data


def glb(**view: float) -> bytes:
    """Returns a GLB of 300 million vertices whose buffer has three; view: of its buffer view."""
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 300_000_000}],
        "bufferViews": [{"buffer": 0, "byteLength": 36, **view}],
        "buffers": [{"byteLength": 36}],
    }
    return with_json(gltf)


def with_json(gltf: dict[str, Any]) -> bytes:
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 36, b"BIN\0") + bytes(36)
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks


def repeated_glb() -> bytes:
    """Returns a GLB of 20,000 nodes that all have the same mesh, of 5,000 primitives."""
    data = glb()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf = json.loads(data[20 : 20 + length])
    gltf["accessors"][0]["count"] = 3
    gltf["meshes"][0]["primitives"] *= 5_000
    gltf["nodes"] *= 20_000
    gltf["scenes"][0]["nodes"] = list(range(20_000))
    return with_json(gltf)


def glb_of(material: dict[str, Any]) -> bytes:
    """Returns a GLB of a triangle with a material."""
    data = glb()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf = json.loads(data[20 : 20 + length])
    gltf["accessors"][0]["count"] = 3
    gltf["materials"] = [material]
    gltf["meshes"][0]["primitives"][0]["material"] = 0
    return with_json(gltf)


ENDLESS = {"emissiveFactor": [1e300, 0, 0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e300}}}


def lying() -> Iterator[Any]:
    yield pytest.param({"a.ply": ply("element nothing 1e300\nelement vertex 3")}, id="PLY, an endless element without properties")
    yield pytest.param({"a.ply": ply("element vertex 4000000000")}, id="PLY, more vertices than bytes")
    yield pytest.param({"a.fbx": overlapping_fbx()}, id="FBX, nodes larger than the one around them")
    yield pytest.param({"a.glb": glb(byteStride=1e-8)}, id="GLB, a stride of almost nothing")
    yield pytest.param({"a.glb": glb(byteStride=-1)}, id="GLB, a negative stride")
    yield pytest.param({"a.glb": glb_of(ENDLESS)}, id="GLB, an infinite emission")
    yield pytest.param({"a.glb": glb_of({"pbrMetallicRoughness": {"metallicFactor": "x"}})}, id="GLB, a word for a number")


@pytest.mark.parametrize("files", list(lying()))
def test_sizes_that_a_file_cannot_have_are_left_to_service(own: Node, files: dict[str, bytes]) -> None:
    assert triangles_of(own, files) is None


READ_LARGE = """
    const made = new Function(a.make)();
    const files = Object.entries(made).map(([path, data]) => ({ path, file: new Blob([data]) }));
    const known = await m.meshOf({ files, formats: a.formats });
    return known && known.packet.triangles;"""


@pytest.mark.parametrize(
    ("make", "triangles"),
    [
        pytest.param(
            """const data = new DataView(new ArrayBuffer(84 + 50 * 400000));
            data.setUint32(80, 400000, true);
            for (let i = 0; i < 400000; i++)
                for (let k = 3; k < 12; k++) data.setFloat32(84 + 50 * i + 4 * k, i % 2 ? NaN : i + k, true);
            return { "a.stl": data };""",
            None,
            id="STL, positions that are no numbers",
        ),
        pytest.param(
            f"""const material = "newmtl a\\nKd 1" + " ".repeat(500000) + "1 1";
            return {{ "a.obj": "mtllib a.mtl\\n" + {json.dumps(TRIANGLE)}, "a.mtl": material }};""",
            1,
            id="MTL, a line of blanks",
        ),
        pytest.param(
            f"""return {{ "a.obj": "mtllib a.mtl\\n".repeat(4000) + {json.dumps(TRIANGLE)}, "a.mtl": "#\\n".repeat(100000) }};""",
            1,
            id="OBJ, the same material file for each object",
        ),
    ],
)
def test_large_files_are_read_in_linear_time(own: Node, make: str, triangles: int | None) -> None:
    assert own.call("mesh/upload", READ_LARGE, {"make": make, "formats": list(SCENE_SUFFIXES)}) == triangles


def test_plain_material_is_read(own: Node) -> None:
    assert triangles_of(own, {"a.glb": glb_of({"alphaMode": "MASK", "extensions": {"KHR_materials_unlit": {}}})}) == 1


def test_instances_are_bounded(own: Node) -> None:
    assert triangles_of(own, {"a.glb": repeated_glb()}) == 20_000


def zip_of(files: dict[str, bytes], stated: int | None = None) -> bytes:
    """Returns a zip; stated: the size in bytes that its directory states for each file."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        for entry in archive.filelist:
            entry.file_size = stated or entry.file_size
    return made.getvalue()


@pytest.mark.parametrize(("stated", "triangles"), [(200 << 20, 1), (300 << 20, None)])
def test_zips_in_a_zip_share_the_limit_of_an_upload(own: Node, stated: int, triangles: int | None) -> None:
    scene, material = ("mtllib a.mtl\n" + TRIANGLE).encode(), b"newmtl a\n"
    inner = {"scene.zip": zip_of({"a.obj": scene}, stated), "materials.zip": zip_of({"a.mtl": material}, stated)}
    assert triangles_of(own, {"a.zip": zip_of(inner)}) == triangles


READ_PARTS = """
    const names = Array.from({ length: a.count }, (_, i) => i);
    const materials = names.map((i) => `newmtl m${i}\\nKe ${i} 0 0\\n`).join("");
    const object = "mtllib a.mtl\\nv 0 0 0\\nv 1 0 0\\nv 0 1 0\\n" + names.map((i) => `usemtl m${i}\\nf 1 2 3\\n`).join("");
    const files = [["a.obj", object], ["a.mtl", materials]].map(([path, data]) => ({ path, file: new Blob([data]) }));
    const { packet, isWhole } = await m.meshOf({ files, formats: a.formats });
    return { triangles: packet.triangles, parts: packet.parts.length, isWhole };"""


def test_parts_that_each_take_a_draw_call_are_bounded(own: Node) -> None:
    found = own.call("mesh/upload", READ_PARTS, {"count": 5_000, "formats": list(SCENE_SUFFIXES)})
    assert found["triangles"] == 5_000
    assert found["parts"] <= 1_001
    assert not found["isWhole"], "the service's mesh replaces it"
