"""Tests of formats that other libraries read: concave faces are filled, and normals agree where two materials meet."""

import numpy as np
import pytest

from renderer.scene.normals import face_normals
from tests.renderer.scene.test_polygons import SHAPES


def collada(points, lists):
    numbers = " ".join(f"{x} {y} {z}" for x, y, z in points)
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert/></technique></profile_COMMON></effect>
    </library_effects><library_materials><material id="a"><instance_effect url="#e"/></material><material id="b">
    <instance_effect url="#e"/></material></library_materials>
    <library_geometries><geometry id="g"><mesh><source id="p">
    <float_array id="f" count="{3 * len(points)}">{numbers}</float_array>
    <technique_common><accessor source="#f" count="{len(points)}" stride="3"><param name="X" type="float"/>
    <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{lists}</mesh></geometry></library_geometries>
    <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="a" target="#a"/><instance_material symbol="b" target="#b"/></technique_common></bind_material>
    </instance_geometry></node></visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def polylist(material, *faces):
    counts, corners = " ".join(str(len(f)) for f in faces), " ".join(str(c) for f in faces for c in f)
    return (
        f'<polylist material="{material}" count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/>'
        f"<vcount>{counts}</vcount><p>{corners}</p></polylist>"
    )


@pytest.mark.parametrize("shape", ["star", "comb", "keyhole", "L"])
def test_concave_faces_of_collada_are_filled(scene, shape):
    flat, area = SHAPES[shape]
    points = [(x, y, 0) for x, y in np.asarray(flat).tolist()]
    description = scene("a.dae", collada(points, polylist("a", range(len(points)))))
    found = sum(np.linalg.norm(face_normals(m.positions, m.triangles), axis=1).sum() / 2 for m in description.meshes)
    assert found == pytest.approx(area, abs=1e-5)


FOLD = [(0, 0, 0), (1, 0, 0), (1, 1, 0.2), (0, 1, 0.2), (0, -1, 0.2), (1, -1, 0.2)]


def usd():
    points = ", ".join(map(str, FOLD))
    return f"""#usda 1.0
def Mesh "m" {{
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 1, 0]
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "catmullClark"
    def GeomSubset "a" {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [0]
        rel material:binding = </red>
    }}
    def GeomSubset "b" {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </blue>
    }}
}}
def Material "red" {{}}
def Material "blue" {{}}
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.dae", collada(FOLD, polylist("a", (0, 1, 2, 3)) + polylist("b", (4, 5, 1, 0)))),
        ("a.usda", usd()),
    ],
)
def test_normals_agree_where_materials_meet(scene, name, text):
    description = scene(name, text)
    assert len(description.meshes) == 2
    seams = []
    for mesh in description.meshes:
        at = np.flatnonzero(np.isin(np.round(mesh.positions[:, 0], 4), (0, 1)) & (np.abs(mesh.positions[:, 1]) < 1e-5))
        assert len(at)
        unit = mesh.normals[at] / np.linalg.norm(mesh.normals[at], axis=1)[:, None]
        seams.append({tuple(np.round(p, 4)): n for p, n in zip(mesh.positions[at], unit, strict=True)})
    assert seams[0].keys() == seams[1].keys()
    for place, normal in seams[0].items():
        np.testing.assert_allclose(normal, seams[1][place], atol=1e-5)
        assert abs(normal[1]) < 1e-4
