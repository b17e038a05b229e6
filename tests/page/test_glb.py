"""Tests of the page's own GLB reader, which makes the first preview in the browser: its meshes equal those of the service."""

from __future__ import annotations

import base64
import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from renderer.preview_mesh import PreviewMesh
from renderer.scene.animation import Moment
from renderer.scene.default_camera import frame
from renderer.scene.load import Shot
from renderer.scene.preview import preview
from tests.page.node import Node

READ = """
    const known = m.readGlb(Uint8Array.from(atob(a.file), (c) => c.charCodeAt(0)), a.most ?? 300000);
    if (!known) return null;
    const { packet, view, isWhole, images } = known;
    const plain = Object.entries(packet).map(([name, value]) => [name, ArrayBuffer.isView(value) ? [...value] : value]);
    return { packet: Object.fromEntries(plain), view, isWhole, images: images.map(({ bytes }) => [...bytes]) };"""


def read_in_page(node: Node, data: bytes, most: int = 300_000) -> Any:
    return node.call("mesh/glb", READ, {"file": base64.b64encode(data).decode(), "most": most})


def read_by_service(folder: Path, data: bytes) -> PreviewMesh:
    (folder / "model.glb").write_bytes(data)
    shot = Shot(folder, "model.glb")
    shown = preview(shot.scene_at(Moment(shot.start)))
    assert shown is not None
    return shown


def positions(packet: Any) -> np.ndarray:
    low, high = np.array(packet["low"]), np.array(packet["high"])
    shares = np.array(packet["positions"]).reshape(-1, 4)[:, :3] / 65535
    return np.asarray(low + shares * (high - low))


@pytest.fixture
def model() -> bytes:
    """Returns a GLB of a box and a sphere, in nested nodes that are rotated and scaled differently per axis."""
    scene = trimesh.Scene()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 64, 0, 255])
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    material.baseColorTexture = Image.fromarray(np.full((2, 4, 3), 200, np.uint8))
    box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2], material=material)
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.5, 0, 1))
    scene.add_geometry(box, node_name="box", transform=turn @ np.diag([1.0, 0.5, 2.0, 1.0]))
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.75)
    scene.add_geometry(
        ball, node_name="ball", parent_node_name="box", transform=trimesh.transformations.translation_matrix((3, 1, 0))
    )
    return bytes(scene.export(file_type="glb", include_normals=True))


def test_browser_mesh_equals_service_mesh(node: Node, tmp_path: Path, model: bytes) -> None:
    found = read_in_page(node, model)
    packet, known = found["packet"], read_by_service(tmp_path, model)
    corners = positions(packet)[np.array(packet["indices"]).reshape(-1, 3)]
    expected = known.positions[known.triangles]
    assert corners.shape == expected.shape
    np.testing.assert_allclose(corners, expected, atol=1e-3)
    np.testing.assert_allclose(packet["low"], known.positions.min(axis=0), atol=1e-5)
    np.testing.assert_allclose(packet["high"], known.positions.max(axis=0), atol=1e-5)
    normals = np.array(packet["normals"]).reshape(-1, 4)[:, :3] / 127
    assert packet["vertices"] == len(known.normals)
    np.testing.assert_allclose(np.sort(normals, axis=0), np.sort(known.normals, axis=0), atol=2e-2)
    colors = {tuple(row) for row in np.array(packet["colors"]).reshape(-1, 4).tolist()}
    assert (255, 137, 0, 255) in colors, "64 / 255 is linear, 137 in sRGB"


def test_textures_are_given_with_their_triangles(node: Node, model: bytes) -> None:
    """The triangles of the box have the texture of its material, and the others none."""
    found = read_in_page(node, model)
    packet, images = found["packet"], found["images"]
    box, ball = packet["parts"]
    assert [packet["materials"][part["material"]]["texture"] for part in (box, ball)] == [0, -1]
    assert (box["first"], box["corners"]) == (0, 36)
    assert (ball["first"], ball["corners"]) == (36, 3 * packet["triangles"] - 36)
    uvs = np.array(packet["uvs"]).reshape(-1, 2)[sorted(set(packet["indices"][:36]))]
    assert {tuple(uv) for uv in uvs.tolist()} == {(x, 1 - y) for x in (-0.5, 0.5) for y in (-1, 1)}, "v goes down in glTF"
    with Image.open(io.BytesIO(bytes(images[0]))) as image:
        assert image.size == (4, 2)


def test_browser_view_equals_automatic_camera(node: Node, tmp_path: Path, model: bytes) -> None:
    view, known = read_in_page(node, model)["view"], frame(read_by_service(tmp_path, model).positions)
    for name in ("eye", "target", "up", "fov"):
        np.testing.assert_allclose(view[name], getattr(known, name), atol=1e-4)


def test_large_mesh_is_decimated(node: Node) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6)  # 81,920 triangles
    data = bytes(trimesh.Scene(ball).export(file_type="glb", include_normals=True))
    packet = read_in_page(node, data, 5000)["packet"]
    assert 1000 < packet["triangles"] < 10_000
    assert max(packet["indices"]) < packet["vertices"]
    radius = np.linalg.norm(positions(packet), axis=1)
    np.testing.assert_allclose(radius, 1.0, atol=1e-3)


@pytest.mark.parametrize("length", [0, 11, 40, -5])
def test_damaged_file_is_left_to_service(node: Node, model: bytes, length: int) -> None:
    assert read_in_page(node, model[:length]) is None


def test_compressed_file_is_left_to_service(node: Node, model: bytes) -> None:
    """The page's reader does not read a file with compressed buffer views (EXT_meshopt_compression).

    The bytes of such views are no coordinates, so the preview is left to the service.
    """
    plain = b'"buffer":0'
    assert plain in model
    assert read_in_page(node, model.replace(plain, b'"buffer":1')) is None


def test_parts_of_one_table_of_vertices_are_drawn_by_texture(node: Node) -> None:
    """Primitives that share a table have their own vertices alone, and those with the same texture are one part."""
    table = np.random.default_rng(3).uniform(size=(3000, 3)).astype("<f4")
    image = io.BytesIO()
    Image.new("RGB", (2, 2)).save(image, "png")
    blobs = [table.tobytes(), table[:, :2].tobytes(), np.arange(9, dtype="<u4").tobytes(), image.getvalue()]
    starts = np.cumsum([0, *map(len, blobs)]).tolist()
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2 + i, "material": i % 2} for i in range(3)]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, {}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(table)},
            {"bufferView": 1, "componentType": 5126, "type": "VEC2", "count": len(table)},
            *({"bufferView": 2, "byteOffset": 12 * i, "componentType": 5125, "type": "SCALAR", "count": 3} for i in range(3)),
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": a, "byteLength": len(b)} for a, b in zip(starts, blobs, strict=False)],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    data = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", starts[-1], b"BIN\0") + b"".join(blobs)
    packet = read_in_page(node, struct.pack("<4s2I", b"glTF", 2, 12 + len(data)) + data)["packet"]
    assert packet["vertices"] == 9
    assert [(packet["materials"][part["material"]]["texture"], part["corners"]) for part in packet["parts"]] == [(0, 6), (-1, 3)]
    found = positions(packet)[packet["indices"]]
    np.testing.assert_allclose(found, table[[0, 1, 2, 6, 7, 8, 3, 4, 5]], atol=1e-4)


def edited(glb: bytes, edit: Callable[[dict[str, Any]], None]) -> bytes:
    """Returns a GLB file with an edited document."""
    (length,) = struct.unpack_from("<I", glb, 12)
    gltf = json.loads(glb[20 : 20 + length])
    edit(gltf)
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    data = struct.pack("<I4s", len(text), b"JSON") + text + glb[20 + length :]
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(data)) + data


def test_textures_of_other_types_are_left_to_the_service(node: Node, model: bytes) -> None:
    def compress(gltf: dict[str, Any]) -> None:
        gltf["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]

    assert read_in_page(node, model)["isWhole"]
    assert not read_in_page(node, edited(model, compress))["isWhole"]


def test_black_lamps_leave_the_studio(node: Node, model: bytes) -> None:
    def add(intensity: float) -> Callable[[dict[str, Any]], None]:
        def edit(gltf: dict[str, Any]) -> None:
            gltf["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": intensity}]}}
            gltf["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}

        return edit

    assert read_in_page(node, edited(model, add(0)))["packet"]["isStudio"]
    assert not read_in_page(node, edited(model, add(5)))["packet"]["isStudio"]


@pytest.mark.parametrize("perspective", [{}, {"yfov": 0}, {"yfov": 4}])
def test_invalid_camera_is_left_out(node: Node, model: bytes, perspective: dict[str, float]) -> None:
    def add(gltf: dict[str, Any]) -> None:
        gltf["cameras"] = [{"type": "perspective", "perspective": perspective}]
        gltf["nodes"][0]["camera"] = 0

    found = read_in_page(node, edited(model, add))
    assert found["view"] == read_in_page(node, model)["view"]
