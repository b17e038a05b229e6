"""Tests of scene files in various text encodings, and with various notations of numbers, such as decimal commas."""

import unicodedata

import numpy as np
import pytest

from renderer.scene.text_encoding import likely_encoding
from tests.renderer.scene.fbx_text import fbx, material, node, texture

QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"
NAMES = [
    ("木纹贴图", "gb18030"),
    ("木目テクスチャ", "cp932"),
    ("Holz für Tür", "latin-1"),
    ("дерево", "cp1251"),
    ("나무", "cp949"),
]


def texture_names(description):
    return [description.images[t.image].name for t in description.textures]


@pytest.mark.parametrize(("name", "encoding"), NAMES)
def test_encoding_is_chosen_by_existing_files(scene, png, name, encoding):
    obj = f"mtllib m.mtl\n{QUAD}usemtl {name}\n{FACE}".encode(encoding)
    mtl = f"newmtl {name}\nmap_Kd {name}.png\n".encode(encoding)
    description = scene("m.obj", obj, {"m.mtl": mtl, f"{name}.png": png(255, 0, 0)})
    assert texture_names(description) == [f"{name}.png"]
    assert description.materials[0].name
    assert any("names are not in UTF-8" in w and "of the files" in w for w in description.warnings)


@pytest.mark.parametrize(("name", "encoding"), [each for each in NAMES if each[1] != "cp949"])
def test_missing_texture_is_named_in_the_likely_encoding(scene, name, encoding):
    objects = node(20, "a") + material(30, "m") + texture(40, f"{name}.png")
    data = fbx(objects, [(30, 20), (40, 30, "DiffuseColor")])
    warnings = scene("a.fbx", data.encode(encoding)).warnings
    assert any(f"{name}.png" in warning and "is not among the files" in warning for warning in warnings)
    assert any("names are not in UTF-8" in warning and "which is a guess" in warning for warning in warnings)


@pytest.mark.parametrize("name", ["나무", "재질", "木目", "材質"])
def test_encoding_of_ambiguous_names_is_not_guessed(name):
    encoding = {"木目": "cp932", "材質": "big5"}.get(name, "cp949")
    assert likely_encoding([name.encode(encoding).decode("utf-8", "surrogateescape")]) is None


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_unicode_with_and_without_bom(scene, png, encoding):
    mark = "\ufeff" if encoding in ("utf-16-le",) else ""
    mtl = f"{mark}newmtl 木\r\nmap_Kd 木.png\r\n".encode(encoding)
    description = scene("m.obj", f"mtllib m.mtl\n{QUAD}usemtl 木\n{FACE}", {"m.mtl": mtl, "木.png": png(255, 0, 0)})
    assert (texture_names(description), description.materials[0].name) == (["木.png"], "木")
    assert not any("UTF-8" in w for w in description.warnings)


def test_different_bytes_stay_different_names(scene):
    mtl = "newmtl grün\nKd 0 1 0\nnewmtl grän\nKd 0 0 1\n".encode("latin-1")
    obj = f"mtllib m.mtl\n{QUAD}usemtl grün\nf 1 2 3\nusemtl grän\nf 1 3 4\n".encode("latin-1")
    description = scene("m.obj", obj, {"m.mtl": mtl})
    found = {m.name: description.materials[m.material].base_color for m in description.meshes}
    assert found == {"grün": (0, 1, 0), "grän": (0, 0, 1)}
    assert any("2 names are not in UTF-8; they are read as CP1252" in w for w in description.warnings)


def test_mtl_in_another_encoding_than_the_obj(scene):
    for one, other in (("utf-8", "gb18030"), ("gb18030", "utf-8")):
        obj = f"mtllib m.mtl\n{QUAD}usemtl 木纹\n{FACE}".encode(one)
        description = scene("m.obj", obj, {"m.mtl": "newmtl 木纹\nKd 1 0 0\n".encode(other)})
        assert description.materials[0].base_color == (1, 0, 0)


@pytest.mark.parametrize(("said", "there"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_composed_and_decomposed_accents_match(scene, png, said, there):
    said, there = unicodedata.normalize(said, "Café Straße"), unicodedata.normalize(there, "café STRASSE")
    mtl = f"newmtl a\nmap_Kd {said}.png\n"
    description = scene("m.obj", f"mtllib m.mtl\n{QUAD}usemtl a\n{FACE}", {"m.mtl": mtl, f"{there}.png": png(255, 0, 0)})
    assert texture_names(description) == [f"{there}.png"]


def test_ply_texture_name_in_gbk(scene, png):
    head = "ply\nformat ascii 1.0\ncomment TextureFile 木纹.png\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float s\nproperty float t\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    data = (head + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n").encode("gbk")
    assert texture_names(scene("a.ply", data, {"木纹.png": png(255, 0, 0)})) == ["木纹.png"]


def test_pbrt_texture_name_in_shift_jis(scene, png):
    text = 'Camera "perspective"\nWorldBegin\nTexture "a" "spectrum" "imagemap" "string filename" "木目.png"\n'
    text += 'Material "diffuse" "texture reflectance" "a"\nShape "disk"\n'
    assert texture_names(scene("a.pbrt", b"\xef\xbb\xbf" + text.encode("utf-8"), {"木目.png": png(255, 0, 0)})) == ["木目.png"]
    assert texture_names(scene("b.pbrt", text.encode("cp932"))) == ["木目.png"]


STL = "solid Tür\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1.5 0\nendloop\nendfacet\nendsolid Tür\n"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_stl_in_several_encodings(scene, encoding, end):
    mesh = scene("a.stl", STL.replace("\n", end).encode(encoding)).meshes[0]
    assert mesh.positions[mesh.triangles].max() == 1.5


PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n0 0 0\n1.5 0 0\n0 1.5 0\n3 0 1 2\n"


@pytest.mark.parametrize(
    ("name", "text"), [("a.stl", STL), ("a.ply", PLY), ("a.off", "OFF\n3 1 0\n0 0 0\n1.5 0 0\n0 1.5 0\n3 0 1 2\n")]
)
def test_decimal_commas_are_read_and_counted(scene, name, text):
    head, mark, rest = text.partition("end_header") if name == "a.ply" else ("", "", text)
    description = scene(name, head + mark + rest.replace("1.5", "1,5"))
    assert description.meshes[0].positions.max() == 1.5
    assert any(f"{rest.count('1.5')} numbers have decimal commas" in w for w in description.warnings)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.stl", STL.replace("endsolid Tür\n", "") + STL.partition("\n")[2].replace("1 0 0", "nan 0 0")),
        (
            "a.ply",
            PLY.replace("vertex 3", "vertex 4").replace("face 1", "face 2").replace("3 0 1 2", "-nan(ind) 0 0\n3 0 1 2\n3 0 1 3"),
        ),
        ("a.off", "OFF\n4 2 0\n0 0 0\n1.5 0 0\n0 1.5 0\ninf 0 0\n3 0 1 2\n3 0 1 3\n"),
    ],
)
def test_faces_with_nonfinite_vertices_are_omitted(scene, name, text):
    description = scene(name, text)
    assert len(description.meshes[0].triangles) == 1
    assert np.isfinite(description.meshes[0].positions).all()
    assert any(
        "1 vertices have positions that are not finite; 1 faces that use them are left out" in w for w in description.warnings
    )
