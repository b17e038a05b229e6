"""Tests of reading untrusted files.

Readers raise only SceneError, whose message names the file, and open no file outside the scene's folder.
"""

import json
import os
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from renderer.errors import SceneError
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.files import SceneFiles, data_uri
from renderer.scene.load import read
from tests.renderer.scene.builders import Gltf, full_gltf
from tests.renderer.scene.finite import is_finite

TRIANGLE_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\n"
SCENE_YAML = """
materials: {m: {kind: glass, ior: 1.4}, l: {emission: 4}}
cameras: [{name: c, eye: [0, 0, 5], target: [0, 0, 0]}]
shapes: [{type: quad, material: l, transform: [{scale: 2}]}, {type: sphere, material: m}]
"""


def edit(path, value):
    """Returns a function that sets the value at `path` in the JSON of `full_gltf`."""

    def change(root):
        *parents, last = path
        for key in parents:
            root = root[key]
        if value is None:
            del root[last]
        else:
            root[last] = value

    return change


BROKEN_GLTF = {
    "index out of range": (("accessors", 0, "bufferView"), 99),
    "accessor too long": (("accessors", 0, "count"), 5),
    "accessor absurd": (("accessors", 0, "count"), 1 << 40),
    "accessor empty": (("accessors", 0, "count"), 0),
    "accessor before its view": (("accessors", 0, "byteOffset"), -4),
    "accessor of another type": (("accessors", 0, "type"), "MAT4"),
    "accessor of no type": (("accessors", 0, "componentType"), 7),
    "view beyond the buffer": (("bufferViews", 1, "byteLength"), 1 << 30),
    "view before the buffer": (("bufferViews", 1, "byteOffset"), -1),
    "stride too short": (("bufferViews", 1, "byteStride"), 1),
    "no buffer": (("bufferViews", 1, "buffer"), 3),
    "indices are floats": (("meshes", 0, "primitives", 0, "indices"), 0),
    "node not there": (("scenes", 0, "nodes"), [17]),
    "node in a loop": (("nodes", 0, "children"), [0]),
    "node twice": (("scenes", 0, "nodes"), [0, 0]),
    "matrix too short": (("nodes", 1, "matrix"), [1, 2, 3]),
    "matrix of words": (("nodes", 1, "matrix"), ["x"] * 16),
    "mesh not there": (("nodes", 0, "mesh"), 5),
    "material not there": (("meshes", 0, "primitives", 0, "material"), 5),
    "texture not there": (("materials", 0, "pbrMetallicRoughness", "baseColorTexture", "index"), 5),
    "factor of words": (("materials", 0, "emissiveFactor"), "bright"),
    "scale of infinity": (("nodes", 0, "scale"), [1e400, 1, 1]),
    "materials no list": (("materials",), {"a": 1}),
    "nodes of numbers": (("nodes",), [1, 2]),
    "no attributes": (("meshes", 0, "primitives", 0, "attributes"), None),
    "glTF 1": (("asset", "version"), "1.0"),
    "scene not there": (("scene",), 4),
    "no nodes shown": (("scenes", 0, "nodes"), []),
}


@pytest.mark.parametrize("case", BROKEN_GLTF)
def test_broken_gltf_error_names_the_fault(scene, png, case):
    g = full_gltf(png)
    edit(*BROKEN_GLTF[case])(g.root)
    try:
        warnings = scene("broken.glb", g.glb()).warnings
    except SceneError as error:
        warnings = [str(error)]
    sentences = [w for w in warnings if w.startswith(("broken.glb: ", "broken.glb "))]
    assert sentences
    assert not any("Error" in sentence for sentence in sentences)  # raised by a reader's own check, not by the general handler


def test_nonfinite_positions(scene):
    g = Gltf()
    g.mesh(np.array([(0, 0, 0), (1, np.nan, 0), (0, 1, 0)], np.float32))
    with pytest.raises(SceneError, match="not finite"):
        scene("a.glb", g.glb())


def test_indices_out_of_range(scene):
    g = Gltf()
    g.mesh(indices=np.array([0, 1, 7], np.uint16))
    with pytest.raises(
        SceneError, match=r"meshes\[0\]\.primitives\[0\]\.indices has the index 7 where there are 3 vertices, in 1 triangles"
    ):
        scene("a.glb", g.glb())


@pytest.mark.parametrize("keep", [0, 3, 4, 11, 19, 30, 200])
def test_truncated_glb_is_an_error(scene, png, keep):
    with pytest.raises(SceneError, match=r"a\.glb"):
        scene("a.glb", full_gltf(png).glb()[:keep])


def test_glb_without_its_last_byte_is_read_partly(scene, png):
    warnings = scene("a.glb", full_gltf(png).glb()[:-1]).warnings
    assert any("its header says" in warning for warning in warnings)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.glb", b"hello"),
        ("a.gltf", b"{}"),
        ("a.gltf", b"[" * 100_000),
        ("a.gltf", b"\xff\xfe\x00"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n"),
        ("a.ply", b"no ply"),
        ("a.stl", b"solid"),
        ("a.stl", bytes(80) + struct.pack("<I", 4_000_000_000)),
        ("a.off", b"OFF\n3 1 0\n"),
        ("a.dae", b"<COLLADA>"),
        ("a.dae", b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>'),
        ("a.yaml", b"\x00"),
        ("a.yaml", b"%"),
        ("a.blend", b"BLENDER"),
        ("a.obj", bytes(range(256))),
    ],
)
def test_non_scene_data_is_an_error(scene, name, data):
    with pytest.raises(SceneError, match=name):
        scene(name, data)


def test_stl_name_in_another_encoding(scene):
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    assert len(scene("a.stl", b"solid W\xfcrfel\n" + facet + b"endsolid W\xfcrfel\n").meshes) == 1


def test_missing_scene_file_is_an_error(tmp_path):
    with pytest.raises(SceneError, match=r"gone\.glb is not among the scene's files"):
        read(tmp_path, "gone.glb")


# Paths that leave the scene's folder.


@pytest.fixture
def secret(tmp_path):
    """Returns (the scene's folder, a file beside this folder), of which readers must not open the file."""
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(np.eye(3, dtype=np.float32).tobytes())
    return folder, tmp_path / "secret.bin"


@pytest.mark.parametrize(
    "form", ["../secret.bin", "{absolute}", "file://{absolute}", "..\\secret.bin", "%2e%2e/secret.bin", "x/../../secret.bin"]
)
def test_buffer_outside_the_folder_is_not_opened(secret, form):
    folder, outside = secret
    g = Gltf()
    g.mesh(np.eye(3, dtype=np.float32))
    (folder / "a.gltf").write_bytes(g.gltf(form.format(absolute=outside)))
    with pytest.raises(SceneError, match="not among the files"):
        read(folder, "a.gltf")


def test_symlink_out_of_the_folder_is_not_followed(secret):
    folder, outside = secret
    g = Gltf()
    g.mesh(np.eye(3, dtype=np.float32))
    (folder / "a.gltf").write_bytes(g.gltf("inside.bin"))
    (folder / "inside.bin").symlink_to(outside)
    (folder / "up").symlink_to(folder.parent)
    with pytest.raises(SceneError, match="not among the files"):
        read(folder, "a.gltf")
    files = SceneFiles(folder)
    for name in ("inside.bin", "up/secret.bin", "../secret.bin", str(outside), "a\0b", "x" * 5000):
        with pytest.raises(SceneError):
            files.read(name)


def test_main_file_outside_the_folder_is_not_opened(secret):
    folder, outside = secret
    outside.with_suffix(".obj").write_text(TRIANGLE_OBJ)
    with pytest.raises(SceneError, match="leads out"):
        read(folder, "../secret.obj")


def test_pipe_is_rejected(tmp_path):
    os.mkfifo(tmp_path / "a.obj")
    with pytest.raises(SceneError, match="not among"):
        read(tmp_path, "a.obj")


def test_directory_is_rejected(scene):
    with pytest.raises(SceneError, match="not among"):
        scene("s.yaml", "shapes: [{type: mesh, file: d.obj}]", {"d.obj/x.txt": b""})


def test_oversized_data_uri_is_rejected(monkeypatch):
    monkeypatch.setattr("renderer.scene.files.MAX_DATA_URI_BYTES", 1 << 20)
    with pytest.raises(SceneError, match="MiB"):
        data_uri("data:;base64," + "A" * (2 << 20), "a.gltf: images[0]")


def test_oversized_file_is_rejected_unread(tmp_path, monkeypatch):
    monkeypatch.setattr("renderer.scene.files.MAX_FILE_BYTES", 10)
    (tmp_path / "a.obj").write_text(TRIANGLE_OBJ)
    with pytest.raises(SceneError, match="at most"):
        read(tmp_path, "a.obj")


def test_images_beyond_the_total_size_are_omitted(scene, png, monkeypatch):
    monkeypatch.setattr("renderer.scene.textures.MAX_IMAGE_BYTES", 20)
    text = "textures: {a: {image: a.png}, b: {image: b.png}}\nmaterials: {m: {texture: a}, n: {texture: b}}\n"
    text += "shapes: [{type: quad}]"
    description = scene("s.yaml", text, {"a.png": png(1, 1, 1), "b.png": png(2, 2, 2)})
    assert [i.name for i in description.images] == ["a.png", "studio"]
    assert any("b.png" in w for w in description.warnings)


def test_missing_or_invalid_environment(scene):
    for others, said in (({}, "not among"), ({"sky.hdr": b"no"}, "cannot be read")):
        with pytest.raises(SceneError, match=said):
            scene("a.obj", TRIANGLE_OBJ, others, environment="sky.hdr")


def mutated(data, sample):
    """Returns the sample with truncations, changed bytes and duplicated pieces, as in damaged or hostile uploads."""
    found = bytearray(sample[: data.draw(st.integers(0, len(sample)), label="length")] if data.draw(st.booleans()) else sample)
    for _ in range(data.draw(st.integers(0, 6), label="changes")):
        if found:
            at = data.draw(st.integers(0, len(found) - 1))
            piece = data.draw(
                st.one_of(st.binary(max_size=4), st.sampled_from([b"-1", b"99999999999", b"null", b"[]", b"1e400", b"\xff" * 4]))
            )
            found[at : at + len(piece)] = piece
    return bytes(found)


def assert_compiles_or_fails(description):
    """Asserts that the description compiles into finite numbers, or is rejected with a SceneError."""
    try:
        scene = compile_scene(description)
    except SceneError as error:
        assert len(str(error)) > 20
    else:
        assert is_finite(scene)
        assert summarise(description, scene)["cameras"]


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
@pytest.mark.parametrize("kind", ["glb", "gltf", "obj", "yaml", "ply"])
def test_damaged_scene_is_read_or_rejected(tmp_path, png, kind, data):
    samples = {
        "glb": full_gltf(png).glb(),
        "gltf": full_gltf(png).gltf(),
        "obj": TRIANGLE_OBJ.encode(),
        "yaml": SCENE_YAML.encode(),
        "ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
        b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    }
    (tmp_path / f"a.{kind}").write_bytes(mutated(data, samples[kind]))
    try:
        description = read(tmp_path, f"a.{kind}")
    except SceneError as error:
        assert f"a.{kind}" in str(error)
        return
    assert_compiles_or_fails(description)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_gltf_with_arbitrary_values_is_read_or_rejected(tmp_path, png, data):
    g = full_gltf(png)
    root = json.loads(g.gltf())
    for _ in range(data.draw(st.integers(1, 3))):
        parent, key = root, data.draw(st.sampled_from(sorted(root)))
        while isinstance(parent[key], dict | list) and parent[key] and data.draw(st.booleans()):
            parent = parent[key]
            key = data.draw(st.sampled_from(sorted(parent) if isinstance(parent, dict) else range(len(parent))))
        parent[key] = data.draw(
            st.sampled_from(
                [None, True, -1, 0, 1, 3, 2**31, 2**70, 0.5, float("nan"), float("inf"), "", "a", [], {}, [0], [[]], {"a": 1}]
            )
        )
    (tmp_path / "a.gltf").write_text(json.dumps(root))
    try:
        description = read(tmp_path, "a.gltf")
    except SceneError as error:
        assert "a.gltf" in str(error)
        assert "could not be read as" not in str(error), "the backstop spoke: a reader let a value through unchecked"
        return
    assert_compiles_or_fails(description)


def test_lone_surrogates_in_names_are_replaced_or_rejected(scene):
    """Names with half of a surrogate pair, which JSON and YAML allow, are replaced or refused.

    Such names can neither be stored nor sent, since they have no UTF-8 encoding.
    """
    g = Gltf()
    g.mesh()
    g.root["nodes"][0] |= {"name": "half \ud800, whole \U0001f600", "camera": 0}
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
    g.root["extensionsUsed"] = ["EXT_\udfff"]
    g.root["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "\udc00" * 500}]}}
    description = scene("a.glb", g.glb())
    assert description.cameras[0].name == "half \ufffd, whole \U0001f600"
    assert description.variants == ["\ufffd" * 200]  # and names are truncated
    json.dumps(summarise(description, compile_scene(description)), ensure_ascii=False).encode()
    for text in ('shapes: [{type: quad, name: "\\ud800"}]', 'materials: {"\\udfff": {}}\nshapes: [{type: quad}]'):
        with pytest.raises(SceneError, match=r"a\.yaml, line 1: is not valid YAML: found invalid Unicode"):
            scene("a.yaml", text)


def test_huge_texture_offset_is_read(scene, png):
    g = full_gltf(png)
    places = {"scale": [1e300, -1e300], "offset": [1e300, 0], "rotation": 1e300}
    g.root["materials"][0]["normalTexture"]["extensions"]["KHR_texture_transform"] = places
    assert np.isfinite(compile_scene(scene("a.glb", g.glb())).texture_transform).all()
