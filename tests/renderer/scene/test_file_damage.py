"""Tests that files which are cut off, or have other content than their suffix says, give errors in plain words."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import pytest

from renderer.errors import SceneError
from renderer.scene.load import read

ROOT = "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
PNG = b"\x89PNG\r\n\x1a\n" + bytes(32)


def packed() -> bytes:
    """Returns the bytes of a zip archive with one file."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("scene.usda", "#usda 1.0\n" * 20)
    return made.getvalue()


def glb_of_declared_length(length: int) -> bytes:
    """Returns a GLB file whose JSON is invalid, with a length of the file in its header."""
    text = b'{"asset":{"version":"2.0"},"nodes":3}   '
    return struct.pack("<4sIIII", b"glTF", 2, length, len(text), 0x4E4F534A) + text


CUT = " ends before its data does. Copy or export it again ("


@pytest.mark.parametrize(
    ("name", "content", "begins"),
    [
        ("a.glb", glb_of_declared_length(5000), " ends before its data does: 60 of 5000 B. Copy or export it again ("),
        ("a.glb", glb_of_declared_length(6_000_000), " ends before its data does: 0 of 6000 kB. Copy or export it again ("),
        ("a.glb", PNG, " is a PNG picture, not a .glb file. Choose the scene's own file ("),
        ("a.glb", b"<!DOCTYPE html><html></html>", " is a web page, not a .glb file"),
        ("a.fbx", glb_of_declared_length(60), " is a binary glTF file, not a .fbx file. Change the end of its name to .glb ("),
        ("a.fbx", b"version https://git-lfs.github.com/spec/v1\n", " is a Git LFS pointer"),
        ("a.fbx", b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", 7400) + b"\xff\0\0\0", CUT),
        ("a.gltf", b'{"asset": {"version": "2.0"}, "nodes": [', CUT + "line 1, column"),
        ("a.usdz", packed()[:100], CUT + "it is not a zip file)"),
        ("a.dae", f"{ROOT}<library_geometries>".encode(), CUT),
        (
            "a.dae",
            ROOT.replace("?>", "?><!-- <tool> -->").encode() + b"<asset/></COLLADA>",
            " is damaged or not a .dae file. Export it again (",
        ),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1", CUT + "line 3)"),
        ("a.obj", b"v 0 0 0\nv 1 0\nv 0 1 0\n", ", line 2: "),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x", ", line 4: 'x' is not a corner of a face"),
        ("a.obj", bytes(1000), " is a file of zeros, as a failed copy leaves it, not a .obj file."),
        ("a.obj", b"<html>\nv\n</html>\n", " is a web page, not a .obj file."),
        ("a.glb", glb_of_declared_length(60), ": nodes"),
        ("a.fbx", b"no model", " is damaged or not an FBX file. Export it again ("),
    ],
)
def test_error_of_damaged_file_begins_with_plain_words(tmp_path: Path, name: str, content: bytes, begins: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError) as caught:
        read(tmp_path, name)
    assert str(caught.value).startswith(name + begins)
