"""Tests of glTF files with an unusable part: the rest is rendered, and a warning counts the part."""

import pickle
import struct

import numpy as np
import pytest

from renderer.confine.reader_errors import Bounds, error_of
from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.readers.gltf.faults import DamagedError
from tests.grids import grid
from tests.renderer.scene.builders import TRIANGLE, Gltf, world

BAD = (np.nan, np.inf)


def has_warning_with(description, *words):
    """Returns whether one warning about unusable parts contains all the words."""
    found = [w for w in description.warnings if "unusable part" in w]
    return any(all(word in warning for word in words) for warning in found)


def test_fault_leaves_the_process_that_reads_the_file():
    fault = DamagedError("duck.glb", "accessor 3", "is cut off")
    found = pickle.loads(pickle.dumps(fault))
    assert (str(found), found.place, found.what) == (str(fault), "accessor 3", "is cut off")
    message = {"error": str(fault), "kind": f"{DamagedError.__module__}.{DamagedError.__qualname__}"}
    received = error_of(message, Bounds(1 << 30, 60.0))
    assert type(received) is SceneError and str(received) == str(fault), "as its class needs more than a sentence"


@grid("value", BAD)
@grid(
    ("key", "width", "field"),
    (
        ("NORMAL", 3, "normals"),
        ("COLOR_0", 4, "colors"),
        ("TEXCOORD_0", 2, "uvs"),
        ("TANGENT", 4, "tangents"),
        ("WEIGHTS_0", 4, None),
    ),
)
def test_nonfinite_attribute_is_omitted(scene, key, width, field, value):
    g = Gltf()
    values = np.full((3, width), 0.5, np.float32)
    values[1, 0] = value
    more = {"NORMAL": np.float32([[0, 0, 1]] * 3)} if key == "TANGENT" else {}
    more |= {"JOINTS_0": np.zeros((3, 4), np.uint8)} if key == "WEIGHTS_0" else {}
    g.mesh(**{key: values}, **more)
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(world(description)[0], TRIANGLE)
    assert field is None or getattr(description.meshes[0], field) is None
    assert has_warning_with(description, "1 unusable part is left out", "not finite numbers", "accessors[1]")


def test_triangle_with_nonfinite_vertex_is_omitted(scene):
    g = Gltf()
    points = np.float32([*TRIANGLE, *(TRIANGLE + 5)])
    points[4, 1] = np.nan
    g.mesh(points)
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(world(description), [TRIANGLE])
    assert np.isfinite(description.meshes[0].positions).all()
    assert has_warning_with(description, "in 1 triangles")


def test_nonfinite_transform_is_omitted(scene):
    g = Gltf()
    g.mesh()["matrix"] = [float("nan")] * 16
    g.mesh()["scale"] = [1, float("inf"), 1]
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": float("nan"), "znear": 0.1}}]
    g.node(camera=0)
    description = scene("a.glb", g.glb())
    for number in (0, 1):
        np.testing.assert_array_equal(world(description, number)[0], TRIANGLE)
    assert len(description.cameras) == 1
    assert has_warning_with(description, "nodes[0].matrix")
    assert has_warning_with(description, "nodes[1].scale")
    assert has_warning_with(description, "cameras[0].perspective.yfov"), description.warnings


def test_nonfinite_keys_are_omitted(scene):
    g = Gltf()
    g.mesh()
    moved = np.float32([(0, 0, 0), (np.nan, 0, 0), (4, 0, 0)])
    sampler = {"input": g.array(np.float32([0, 1, 2])), "output": g.array(moved)}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    g.root["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    description = scene("a.glb", g.glb(), moment=Moment(frame=1, fps=1.0))
    np.testing.assert_allclose(world(description)[0][0], (2, 0, 0), atol=1e-6)
    assert has_warning_with(description, "has 1 keys of 3")


def _spoil_count(g):
    g.root["accessors"][-1]["count"] = 0


def _spoil_view(g):
    g.root["accessors"][-1]["bufferView"] = 99


def _spoil_position(g):
    g.root["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = 77


def _spoil_mode(g):
    g.root["meshes"][1]["primitives"][0]["mode"] = 9


def _spoil_offset(g):
    g.root["accessors"][-1]["byteOffset"] = 10_000


def _spoil_attributes(g):
    del g.root["meshes"][1]["primitives"][0]["attributes"]


@grid("spoil", (_spoil_count, _spoil_view, _spoil_position, _spoil_mode, _spoil_offset, _spoil_attributes))
def test_unusable_primitive_is_omitted(scene, spoil):
    g = Gltf()
    g.mesh()
    g.mesh()
    spoil(g)
    description = scene("a.glb", g.glb())
    assert len(description.instances) == 1
    assert has_warning_with(description, "1 unusable part is left out")
    g.root["scenes"][0]["nodes"] = [1]
    with pytest.raises(SceneError, match="export"):  # fails if the file shows nothing else
        scene("a.glb", g.glb())


def test_triangles_with_invalid_indices_are_omitted(scene):
    g = Gltf()
    g.mesh(indices=np.uint16([0, 1, 2, 0, 1, 9]))
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(world(description), [TRIANGLE])
    assert has_warning_with(description, "has the index 9 where there are 3 vertices, in 1 triangles")


def test_invalid_references_are_omitted(scene):
    g = Gltf()
    g.mesh(material=5)
    g.node(mesh=7)
    g.node(camera=3)
    g.node(children=[0, 42], extensions={"KHR_lights_punctual": {"light": 2}})
    g.root["scenes"][0]["nodes"] = [1, 2, 3]
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(world(description)[0], TRIANGLE)
    for place in ("primitives[0].material", "nodes[1].mesh", "nodes[2].camera", "nodes[3].children"):
        assert has_warning_with(description, place), place


@grid("children", ({0: [1], 1: [0]}, {0: [0]}, {0: [1], 2: [1]}))
def test_node_with_two_parents_or_cycle_is_used_once(scene, children):
    g = Gltf()
    for _ in range(3):
        g.mesh()
    for number, below in children.items():
        g.root["nodes"][number]["children"] = below
    g.root["scenes"][0]["nodes"] = [0, 2]
    description = scene("a.glb", g.glb())
    assert len(description.instances) == (2 if children == {0: [0]} else 3)
    assert has_warning_with(description, "1 unusable part is left out", "shown once")


def unpadded(data, pad=b"", length=None):
    """Returns a GLB whose JSON chunk is not padded; `length` is the file length in its header."""
    size = struct.unpack_from("<I", data, 12)[0]
    text = data[20 : 20 + size].rstrip()
    text += b" " * (len(text) % 4 == 0)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + pad[: -len(text) % 4] + data[20 + size :]
    return struct.pack("<4sII", b"glTF", 2, length or 12 + len(chunks)) + chunks


def test_glb_with_wrong_lengths_is_read(scene):
    g = Gltf()
    g.mesh()
    good = g.glb()
    for data in (unpadded(good), unpadded(good, b"   ")):
        description = scene("a.glb", data)
        np.testing.assert_array_equal(world(description)[0], TRIANGLE)
        assert any("bytes, not a multiple of four; it is read nevertheless" in w for w in description.warnings)
    for length in (20, len(good) - 4, len(good) + 100):
        description = scene("a.glb", good[:8] + struct.pack("<I", length) + good[12:])
        np.testing.assert_array_equal(world(description)[0], TRIANGLE)
        assert any(f"its header says {length}" in w for w in description.warnings)


def test_glb_with_truncated_binary_is_read_partly(scene):
    g = Gltf()
    g.mesh()
    g.mesh()
    description = scene("a.glb", g.glb()[:-4])
    assert len(description.instances) == 1
    assert any("of 72 bytes; these are read" in w for w in description.warnings)


def test_uri_query_and_fragment_are_ignored(scene, png):
    g = Gltf()
    texture = g.texture({"uri": "a.png?v=17"})
    g.material(pbrMetallicRoughness={"baseColorTexture": {"index": texture}})
    g.mesh(material=0)
    for uri, file in (
        ("a.png?v=17", "a.png"),
        ("a%20b.png#x", "a b.png"),
        ("c.png?v=1#y", "c.png"),
        ("d#1.png", "d#1.png"),
        ("e%231.png?v", "e#1.png"),
    ):
        g.root["images"][0]["uri"] = uri
        assert [image.name for image in scene("a.glb", g.glb(), {file: png(255, 0, 0)}).images] == [file, "studio"]
