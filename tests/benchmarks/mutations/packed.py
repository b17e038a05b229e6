"""Valid files with compressed content, as input for damage: glTF's buffers and images, textures, zips, .blend files."""

from __future__ import annotations

import base64
import io
import struct
import subprocess
import tempfile
import zipfile
import zlib
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import OpenImageIO as oiio  # noqa: N813
from PIL import Image

from renderer.image.encode import encode
from tests.benchmarks.mutations.seed import Seed
from tests.peers.blender import python_with_bpy
from tests.renderer.scene.builders import TRIANGLE, Gltf
from tests.renderer.scene.test_gltf_packed import KTX2, packed

__all__ = ["blends", "packed_gltf", "pictures", "serialized_mesh", "textures", "zips"]

SIZE = 16
_SAVE = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=False)
cube = bpy.data.objects["Cube"]
cube.modifiers.new("round", "SUBSURF")
for index in (0, 1):
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1 + index], compress=bool(index), check_existing=False)
"""


def _pixels() -> np.ndarray:
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    return np.stack([x * 15, y * 15, (x ^ y) * 15, np.full_like(x, 255)], -1).astype(np.uint8)


def pictures() -> dict[str, bytes]:
    """Returns a small picture in every texture format that this machine can write, by file name."""
    made: dict[str, bytes] = {}
    for suffix, form in (
        ("png", "PNG"),
        ("jpg", "JPEG"),
        ("webp", "WEBP"),
        ("avif", "AVIF"),
        ("tga", "TGA"),
        ("bmp", "BMP"),
        ("gif", "GIF"),
        ("dds", "DDS"),
        ("jp2", "JPEG2000"),
    ):
        out = io.BytesIO()
        Image.fromarray(_pixels()).convert("RGBA" if form in ("PNG", "WEBP", "TGA", "DDS") else "RGB").save(out, form)
        made[f"a.{suffix}"] = out.getvalue()
    # A DDS of 4 x 4 blocks of BC5: a two-channel normal map.
    header = struct.pack("<4s7I44x2I4s20xI16x", b"DDS ", 124, 0x81007, SIZE, SIZE, SIZE * SIZE, 0, 0, 32, 4, b"ATI2", 0x1000)
    made["bc5.dds"] = header + bytes(range(256))[: SIZE * SIZE]
    light = _pixels()[..., :3].astype(np.float32) / 64
    made["a.exr"] = encode(light, "exr")
    with tempfile.TemporaryDirectory(prefix="rayfarm-seeds-") as folder:
        for name, kind in (
            ("a.hdr", "float"),
            ("half.exr", "half"),
            ("a.tif", "uint8"),
            ("wide.tif", "float"),
            ("deep.tif", "uint16"),
            ("a.ppm", "uint8"),
            ("a.pfm", "float"),
            ("a.sgi", "uint8"),
        ):
            path = Path(folder) / name
            file = oiio.ImageOutput.create(str(path))
            file.open(str(path), oiio.ImageSpec(SIZE, SIZE, 3, kind))
            file.write_image(np.ascontiguousarray(light))
            file.close()
            made[name] = path.read_bytes()
    for name, text in KTX2.items():
        made[f"{name.lower()}.ktx2"] = zlib.decompress(base64.b85decode(text))
    return made


def textures() -> list[Seed]:
    """Returns scenes of a textured square, one for each picture of `pictures`."""
    scene = "shapes: [{{type: quad, material: m}}]\ntextures: {{t: {{image: {0}}}}}\nmaterials: {{m: {{texture: t}}}}\n"
    lit = "shapes: [{{type: sphere}}]\nenvironment: {{image: {0}}}\n"
    found: list[Seed] = []
    for name, data in pictures().items():
        shown = [scene, lit] if name.endswith((".exr", ".hdr")) else [scene]
        found += [Seed("scene.yaml", {"scene.yaml": text.format(name).encode(), name: data}, (name,)) for text in shown]
    return found


def packed_gltf() -> list[Seed]:
    """Returns glTF scenes whose compressed buffers and images are separate files.

    So damage affects the compressed data, not the JSON around it.
    """
    made = packed()
    found = [_apart(made)]
    points = np.random.default_rng(5).random((30, 3)).astype(np.float32)
    faces = np.array([(i, i + 1, i + 2) for i in range(28)], np.uint32)
    block = DracoPy.encode(points, faces, quantization_bits=16, preserve_order=True)
    compressed = Gltf()
    node = compressed.mesh(points, faces.reshape(-1))
    primitive = compressed.root["meshes"][node["mesh"]]["primitives"][0]
    compressed.binary.clear()
    compressed.root["bufferViews"].clear()
    identifier = DracoPy.decode(block).attributes[0]["unique_id"]
    extension = {"bufferView": compressed.view(block), "attributes": {"POSITION": identifier}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    for accessor in compressed.root["accessors"]:
        del accessor["bufferView"]
    found.append(_apart(compressed))
    images = pictures()
    for name, form in (
        ("etc1s.ktx2", "KHR_texture_basisu"),
        ("uastc.ktx2", "KHR_texture_basisu"),
        ("a.webp", "EXT_texture_webp"),
        ("a.avif", "EXT_texture_avif"),
    ):
        shown = Gltf()
        texture = shown.texture({"uri": name})
        shown.root["textures"][texture] = {"extensions": {form: {"source": 0}}}
        shown.mesh(material=shown.material(pbrMetallicRoughness={"baseColorTexture": {"index": texture}}))
        found.append(Seed("a.gltf", {"a.gltf": shown.gltf(), name: images[name]}, (name,)))
    sparse = Gltf()
    sparse.mesh(TRIANGLE)
    places, values = sparse.view(np.array([1], np.uint16).tobytes()), sparse.view(np.array([(2, 0, 0)], np.float32).tobytes())
    parts: dict[str, Any] = {"indices": {"bufferView": places, "componentType": 5123}, "values": {"bufferView": values}}
    sparse.root["accessors"][0]["sparse"] = {"count": 1, **parts}
    return [*found, _apart(sparse)]


def _apart(made: Gltf) -> Seed:
    return Seed("a.gltf", {"a.gltf": made.gltf("a.bin"), "a.bin": bytes(made.binary)}, ("a.bin",))


def serialized_mesh() -> bytes:
    """Returns the bytes of a file in Mitsuba's serialized format, with one triangle, its normals and its texture coordinates."""
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    normals, uvs = np.tile(np.array([0, 0, 1], "<f4"), (3, 1)), np.ascontiguousarray(places[:, :2])
    body = (
        struct.pack("<I", 0x1003) + b"sheet\0" + struct.pack("<QQ", 3, 1) + places.tobytes() + normals.tobytes() + uvs.tobytes()
    )
    mesh = struct.pack("<HH", 0x041C, 4) + zlib.compress(body + np.array([0, 1, 2], "<u4").tobytes(), 0)
    return mesh + struct.pack("<QI", 0, 1)


def zips(scene: dict[str, bytes]) -> list[Seed]:
    """Returns the scene's files packed in a zip, once for each supported compression method."""
    found: list[Seed] = []
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", method) as archive:
            for name, data in scene.items():
                archive.writestr(f"model/{name}", data)
        found.append(Seed("scene.zip", {"scene.zip": out.getvalue()}))
    return found


def blends() -> list[Seed]:
    """Returns .blend files saved by Blender, uncompressed and compressed; an empty list if Blender is not installed."""
    python = python_with_bpy()
    if python is None:
        return []
    with tempfile.TemporaryDirectory(prefix="rayfarm-seeds-") as name:
        paths = [Path(name) / "plain.blend", Path(name) / "compressed.blend"]
        subprocess.run([python, "-I", "-c", _SAVE, *map(str, paths)], check=True, capture_output=True, timeout=300)
        return [Seed("a.blend", {"a.blend": path.read_bytes()}) for path in paths]
