"""Tests that small files that expand enormously are read or refused within a few seconds."""

import gzip
import json
import struct
import time

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.readers.gltf.accessors import MAX_BARE
from renderer.scene.readers.pbrt import expansion_limits, shapes
from tests.renderer.scene.builders import TRIANGLE, Gltf
from tests.renderer.scene.pbrt_files import world
from tests.renderer.scene.test_assimp import collada
from tests.renderer.scene.test_threemf import model, package, solid
from tests.renderer.scene.usd_files import read as read_usd

SECONDS = 10.0  # processor time allowed for each file
TRI = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]\n'
LOOP = 'Shape "loopsubdiv" "integer indices" [0 1 2] "point3 P" [0 0 0 1 0 0 0 1 0] "integer levels" 1000000000\n'


@pytest.fixture(autouse=True)
def soon():
    """Fails the test if it uses more than SECONDS of processor time."""
    begun = time.process_time()
    yield
    assert time.process_time() - begun < SECONDS


def doubled(first, each, levels):
    """Returns a text of `first` and `levels` further items, each of which refers twice to the item before it.

    The last item thus expands to 2**levels copies of the first. each: an item's template, with its number and the one before.
    """
    return first + "".join(each.format(i + 1, i) for i in range(levels))


PBRT = {
    "a file that includes itself": (
        'Include "b.pbrt"\n',
        {"b.pbrt": 'Include "b.pbrt"\n' * 2},
        "files include each other to a depth of 32",
    ),
    "a file again and again": (
        'Include "b.pbrt"\n' * 40,
        {"b.pbrt": "#" + "x" * (1 << 20) + "\n"},
        "repeated includes come to more than 16 MiB",
    ),
    "a packed file": (
        'Include "b.pbrt.gz"\n',
        {"b.pbrt.gz": gzip.compress(bytes(32 << 20), 9)},
        "unpacks to more than 16 MiB, as zip bombs do",
    ),
}


@pytest.mark.parametrize("bomb", PBRT)
def test_pbrt(scene, bomb):
    inside, others, says = PBRT[bomb]
    with pytest.raises(SceneError, match=says):
        scene("a.pbrt", world(inside), others)


def test_pbrt_instances_are_counted_before_placing(scene, monkeypatch):
    monkeypatch.setattr(shapes, "_MOST_INSTANCES", 2000)
    text = 'ObjectBegin "a"\n' + TRI * 300 + "ObjectEnd\n" + 'ObjectInstance "a"\n'
    assert len(scene("a.pbrt", world(text)).instances) == 300
    with pytest.raises(SceneError, match=r"line 31\d: with it more than 2000 shapes are shown"):
        scene("a.pbrt", world(text + 'ObjectInstance "a"\n' * 6))


def test_pbrt_subdivision_levels_are_limited(scene, monkeypatch):
    monkeypatch.setattr(expansion_limits, "_MOST", 50_000)
    monkeypatch.setattr(expansion_limits, "_MOST_OF_ONE", 20_000)
    description = scene("a.pbrt", world(LOOP * 6))
    counts = [len(mesh.triangles) for mesh in description.meshes]
    assert counts == [4**7] * 3 + [4**4] * 3
    assert any("times in place of 1000000000, to limit its size" in warning for warning in description.warnings)


def test_pbrt_quadrics_are_cached_and_coarsened(scene):
    parts = "".join(f'Shape "sphere" "float radius" {1 + i / 999} "float zmax" 0.5\n' * 2 for i in range(80))
    description = scene("a.pbrt", world(parts))
    assert len(description.meshes) == 80
    assert len(description.instances) == 160
    assert sum(len(mesh.triangles) for mesh in description.meshes) < 64 * 40_000 + 16 * 10_000
    assert any("drawn coarser" in warning for warning in description.warnings)


def entities(open="<!DOCTYPE s [", close="]>"):
    """Returns XML entity declarations that expand to a billion characters."""
    text = '<!ENTITY a0 "' + "a" * 1000 + '">'
    return open + text + "".join(f'<!ENTITY a{i + 1} "' + f"&a{i};" * 100 + '">' for i in range(3)) + close


MITSUBA = {
    "entities": (entities() + '<scene version="3.0.0"><string name="x" value="&a3;"/></scene>', "declares XML entities"),
    "a file that includes itself": ('<scene version="3.0.0">' + '<include filename="a.xml"/>' * 2 + "</scene>", "are included"),
    "groups of groups": (
        '<scene version="3.0.0"><shape type="shapegroup" id="g0">'
        + '<shape type="sphere"/>' * 10
        + "</shape>"
        + "".join(
            f'<shape type="shapegroup" id="g{i + 1}">' + f'<shape type="instance"><ref id="g{i}"/></shape>' * 10 + "</shape>"
            for i in range(8)
        )
        + '<shape type="instance"><ref id="g8"/></shape></scene>',
        "its node references show more than 500000 nodes; reduce them",
    ),
}


@pytest.mark.parametrize(("bomb", "encoding"), [*((bomb, "utf-8") for bomb in MITSUBA), ("entities", "utf-16")])
def test_mitsuba(scene, bomb, encoding):
    text, says = MITSUBA[bomb]
    with pytest.raises(SceneError, match=says):
        scene("a.xml", f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))


def bare(**arrays):
    """Returns a glTF mesh whose accessors have a count but no data."""
    g = Gltf()
    g.mesh(TRIANGLE, np.array([0, 1, 2], np.uint8))
    for name, count in arrays.items():
        accessor = g.root["accessors"][{"positions": 0, "indices": 1}[name]]
        del accessor["bufferView"]
        accessor["count"] = count
    return g


@pytest.mark.parametrize("arrays", [{"positions": 1 << 26}, {"indices": 3 << 24}])
def test_gltf_accessors_without_data_are_limited(scene, arrays):
    with pytest.raises(SceneError, match="4 million vertices or indices have no data"):
        scene("a.glb", bare(**arrays).glb())
    assert len(scene("b.glb", bare(positions=30).glb()).meshes[0].positions) == 30
    assert MAX_BARE >= 1 << 22


def test_gltf_instances_are_counted_before_reading(scene):
    g = Gltf()
    node = g.mesh()
    g.root["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 60_000_000})
    node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}
    with pytest.raises(
        SceneError,
        match=r"nodes\[0\]\.extensions\.EXT_mesh_gpu_instancing places its mesh 60000000 times, but only 500000 more are allowed",
    ):
        scene("a.glb", g.glb())


MESH = (
    'def Mesh "m" {\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0,1,2]\n'
    "point3f[] points = [(0,0,0),(1,0,0),(0,1,0)]\n"
    'uniform token subdivisionScheme = "none"\n}\n'
)


def usda(body):
    return '#usda 1.0\n(defaultPrim = "W")\n' + body


@pytest.mark.parametrize("arc", ["references", "inherits", "payload", "instanceable = true\nreferences"])
def test_doubling_usd_references_are_counted_before_composition(tmp_path, arc):
    def prim(name, level):
        return f'def "{name}" (\n{arc} = </L{level}>\n) {{\n}}\n'

    doubling = (f'class Xform "L{i + 1}" {{\n{prim("a", i)}{prim("b", i)}}}\n' for i in range(30))
    text = usda(f'def Xform "W" {{\n{prim("a", 30)}}}\nclass Xform "L0" {{\n{MESH}}}\n' + "".join(doubling))
    (tmp_path / "a.usda").write_text(text)
    with pytest.raises(SceneError, match="its node references show more than 4000000 nodes; reduce them"):
        read_usd(tmp_path / "a.usda")


@pytest.mark.long
def test_usd_polygon_with_many_corners_is_triangulated_quickly(tmp_path):
    count = 6000
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    far = np.where(np.arange(count) % 2, 1.0, 0.6)
    points = ",".join(f"({x:.5f},{y:.5f},0)" for x, y in zip(far * np.cos(turn), far * np.sin(turn), strict=True))
    mesh = MESH.replace("[3]", f"[{count}]").replace("[0,1,2]", str(list(range(count))))
    (tmp_path / "a.usda").write_text(usda(mesh.replace("[(0,0,0),(1,0,0),(0,1,0)]", f"[{points}]").replace('"m"', '"W"')))
    (found,) = read_usd(tmp_path / "a.usda").meshes
    a, b, c = (found.positions[found.triangles[:, k], :2].astype(float) for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert areas.sum() == pytest.approx(0.5 * count * 0.6 * np.sin(2 * np.pi / count), rel=1e-3)
    assert areas.min() > -1e-6


THREEMF = {
    "components of components": (
        "".join(
            f'<object id="{i + 2}"><components>' + f'<component objectid="{i + 1}"/>' * 10 + "</components></object>"
            for i in range(9)
        ),
        "its node references show more than 500000 nodes; reduce them",
    ),
    "components within themselves": (
        '<object id="10"><components><component objectid="10"/><component objectid="10"/></components></object>',
        "its nodes contain each other",
    ),
    "a part of spaces": (" " * (48 << 20), "times its size, as zip bombs do"),
}


@pytest.mark.parametrize("bomb", THREEMF)
@pytest.mark.parametrize("first", [solid(), '<object id="1"><mesh><vertices/><triangles/></mesh></object>'])
def test_threemf(scene, bomb, first):
    resources, says = THREEMF[bomb]
    with pytest.raises(SceneError, match=says):
        scene("a.3mf", package(model(first + resources, '<item objectid="10"/>')))


def with_nodes(nodes, shown):
    """Returns the Collada sample with further nodes in its library, one of which the scene shows."""
    text = collada().replace("</library_nodes>", nodes + "</library_nodes>")
    return text.replace("</visual_scene>", f'<node id="z"><instance_node url="#{shown}"/></node></visual_scene>')


NODES = doubled('<node id="n0"/>', '<node id="n{0}"><instance_node url="#n{1}"/><instance_node url="#n{1}"/></node>', 30)
DEEP = "<node>" * 3000 + "</node>" * 3000
GROUP = '<Group DEF="g0"><Shape><Sphere/></Shape></Group>'
USED = doubled(GROUP, '<Group DEF="g{0}"><Group USE="g{1}"/><Group USE="g{1}"/></Group>', 30)
XML = {
    "Collada's nodes that double": ("a.dae", with_nodes(NODES, "n30"), "more than 500000"),
    "a Collada node in itself": ("a.dae", with_nodes('<node id="p"><instance_node url="#p"/></node>', "p"), "contain each other"),
    "Collada's nodes very deep": (
        "a.dae",
        with_nodes(f'<node id="p">{DEEP}</node>', "p"),
        "its nodes are nested more than 500 levels deep. Flatten its hierarchy",
    ),
    "Collada's entities": ("a.dae", collada().replace("<COLLADA", entities() + "<COLLADA"), "declares XML entities"),
    "X3D's groups that double": ("a.x3d", f"<X3D><Scene>{USED}</Scene></X3D>", "more than 500000"),
    "an X3D group in itself": (
        "a.x3d",
        '<X3D><Scene><Group DEF="a"><Group USE="a"/></Group></Scene></X3D>',
        "contain each other",
    ),
}


@pytest.mark.parametrize("bomb", XML)
def test_expanding_xml_references(scene, bomb):
    name, text, says = XML[bomb]
    with pytest.raises(SceneError, match=says):
        scene(name, text)


HEADER = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
LISTS = "property list uchar int vertex_indices\nend_header\n"
COUNTS = {
    "PLY, binary": ("a.ply", HEADER.format("binary_little_endian", 10**12, 1) + LISTS + "0 0 0\n" * 5),
    "PLY, text": ("a.ply", HEADER.format("ascii", 10**12, 1) + LISTS + "0 0 0\n" * 5),
    "STL": ("a.stl", bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50)),
    "OFF": ("a.off", "OFF\n1000000000 1000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "a GLB chunk": ("a.glb", struct.pack("<4sII", b"glTF", 2, 28) + struct.pack("<II", 4_000_000_000, 0x4E4F534A) + bytes(8)),
    "JSON": ("a.gltf", json.dumps({"asset": {"version": "2.0"}})[:-1] + ',"a":' + "[" * 100_000 + "]" * 100_000 + "}"),
}


@pytest.mark.parametrize("format", COUNTS)
def test_counts_without_data(scene, format):
    try:
        assert len(scene(*COUNTS[format]).meshes[0].positions) < 100
    except SceneError as error:
        assert str(error).startswith("a.")
        assert "could not be read as" not in str(error)
