"""Tests that values which readers guess, replace or drop are named in a warning, with a count."""

import io

import numpy as np
import pytest
from PIL import Image
from pxr import UsdGeom, UsdLux, UsdShade

from tests.renderer.scene import usd_files
from tests.renderer.scene.builders import TRIANGLE, Gltf
from tests.renderer.scene.fbx_text import fbx, material
from tests.renderer.scene.test_collada_holes import HOLES, SQUARE, document
from tests.renderer.scene.test_threemf import model, package, solid

FACE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def obj(mtl):
    return "a.obj", f"mtllib a.mtl\nusemtl a\n{FACE}usemtl b\nf 3/3 2/2 1/1\n", mtl


@pytest.mark.parametrize(
    ("statements", "said"),
    [
        ("d 0", "2 materials have an opacity of 0 (d 0 or Tr 1), read as opaque"),
        ("Kd 0 0 0\nmap_Kd t.png", "2 materials have a black Kd beside map_Kd, read as white"),
        (
            "Kd 1 1 1\nNs 100\nKs .5 .5 .5\nNi 1",
            "2 materials have an index of refraction (Ni) of at most 1, read as 1.5",
        ),
        ("bump n.png", "2 materials have a bump map of mostly blue pixels, read as a normal map"),
        ("illum 7\nmap_Kd t.png", "2 materials have a texture (map_Kd) on glass, which is left out"),
        ("Kd 1 1 1\nTf .5 1 1", "Material a: not supported and left out: tf .5 1 1."),
        ("illum 7\nd 0.25", "Material b: not supported and left out: d 0.25."),
        ("map_Kd -t 1 1 1 -cc on t.png", "Material a: not supported and left out: the options -t, -cc on of t.png"),
        ("map_Kd -imfchan z t.png", "the options -imfchan z of t.png"),
    ],
)
def test_materials_of_obj_files(scene, png, statements, said):
    name, text, mtl = obj("".join(f"newmtl {each}\n{statements}\n" for each in "ab"))
    found = scene(name, text, {"a.mtl": mtl, "t.png": png(200, 100, 50), "n.png": blue()})
    assert any(said in w for w in found.warnings), found.warnings


def blue():
    """Returns the PNG of a uniform normal map."""
    out = io.BytesIO()
    Image.new("RGB", (4, 4), (128, 128, 255)).save(out, "PNG")
    return out.getvalue()


@pytest.mark.parametrize("statements", ["Ka 1 1 1\nillum 2\nTf 1 1 1\nd 1.0\nTr 0\nKm 0\nsharpness 60", "Tf 0 0 0\nillum 4"])
def test_statements_without_effect_cause_no_warning(scene, statements):
    name, text, mtl = obj("".join(f"newmtl {each}\nKd .5 .5 .5\nNi 1.5\n{statements}\n" for each in "ab"))
    assert not [w for w in scene(name, text, {"a.mtl": mtl}).warnings if "light" not in w]


def test_materials_of_the_same_name_and_files_that_are_missing(scene):
    mtl = "newmtl a\nKd 1 0 0\nnewmtl a\nKd 0 1 0\nnewmtl b\nKd 1 1 1\n"
    name, text, _ = obj("")
    found = scene(name, text.replace("a.mtl", "a.mtl gone.mtl"), {"a.mtl": mtl})
    assert any("1 material has the name of another material; they are merged" in w for w in found.warnings)
    assert any("gone.mtl is not among the files" in w for w in found.warnings)
    bare = scene("b.obj", "usemtl red\n" + FACE + "f 1 2\nusemtl blue\nf 3 2 1\n")
    assert any("its faces use 2 materials, but there is no material file; add it" in w for w in bare.warnings)
    assert any("1 faces have fewer than three corners and are left out" in w for w in bare.warnings)


def gltf(change):
    made = Gltf()
    look = {"baseColorFactor": [1, 2, 1, 1], "roughnessFactor": -3}
    texture = made.texture({"uri": "t.png"}, wrapS=5, magFilter=6)
    look["baseColorTexture"] = {"index": texture}
    made.mesh(indices=np.array([0, 1, 2, 0], np.uint16), material=made.material(pbrMetallicRoughness=look))
    change(made)
    return made.glb()


def camera(made):
    made.root["cameras"] = [{"type": "perspective"}]
    made.node(camera=0)


def morph(made):
    node = made.mesh()
    target = {"POSITION": made.array(TRIANGLE), "COLOR_0": made.array(TRIANGLE)}
    made.root["meshes"][node["mesh"]] |= {"weights": [1.0]}
    made.root["meshes"][node["mesh"]]["primitives"][0]["targets"] = [target]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda g: None, "2 values are out of range and clamped: materials[0].pbrMetallicRoughness.baseColorFactor, "),
        (lambda g: None, "1 value is unknown (5) and replaced by REPEAT: samplers[0].wrapS"),
        (lambda g: None, "1 value is unknown (6) and replaced by LINEAR: samplers[0].magFilter"),
        (lambda g: None, "(ends with 1 of a triangle's three indices): meshes[0].primitives[0].indices"),
        (lambda g: g.root["scenes"].append({}), "1 of its 2 scenes are left out"),
        (camera, "1 value is missing and replaced by 40 degrees: cameras[0].perspective.yfov"),
        (lambda g: g.mesh(JOINTS_0=np.zeros((3, 4), np.uint16)), "joints without weights"),
        (morph, "displaces texture coordinates or colours, which is not supported"),
    ],
)
def test_values_of_gltf_files(scene, png, change, said):
    found = scene("a.glb", gltf(change), {"t.png": png(1, 2, 3)})
    assert any(said in w for w in found.warnings), found.warnings


def test_rounding_in_gltf_causes_no_warning(scene):
    made = Gltf()
    look = {"baseColorFactor": [1.0000001, 1, 1, 1], "roughnessFactor": -1e-9}
    made.mesh(material=made.material(pbrMetallicRoughness=look))
    assert not [w for w in scene("a.glb", made.glb()).warnings if "range" in w]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"TransparencyFactor": 1.0, "TransparentColor": (1, 1, 1)}, "1 materials of opacity 0, read as opaque"),
    ],
)
def test_materials_of_fbx_files(scene, values, said):
    found = scene("a.fbx", fbx(material(30, "red", **values), [(30, 20)]))
    assert any(said in w for w in found.warnings), found.warnings


def test_properties_of_3mf_files(scene):
    look = '<basematerials id="5"><base name="a" displaycolor="red"/><base name="b" displaycolor="#12345G"/></basematerials>'
    corners = 'v1="0" v2="1" v3="2"'
    triangles = f'<triangle {corners} pid="5" p1="7"/><triangle {corners} pid="5" p1="0"/><triangle {corners} pid="9" p1="0"/>'
    build = '<item objectid="1"/>'
    found = scene("a.3mf", package(model(look + solid(1, triangles), build), Metadata__model_settings_config="<config"))
    sentences = " ".join(found.warnings)
    assert "2 colours that are not #RRGGBB or #RRGGBBAA and are shown white" in sentences
    assert "1 triangles whose properties (pid) are not in the file" in sentences
    assert "1 triangles whose property index is out of range, read with the last property of the group" in sentences
    damaged = package(model(solid(), build), **{"Metadata__model_settings.config": "<config"})
    sentences = " ".join(scene("b.3mf", damaged).warnings)
    assert "the slicer's data of filaments is damaged and left out" in sentences
    assert "the slicer's data of parts is damaged and left out" in sentences


def test_units_and_surfaces_of_collada_files(scene):
    text = document(SQUARE + HOLES[0], ["4 5 6 7"])
    unit = text.replace("<library_geometries>", '<asset><unit meter="yard"/></asset><library_geometries>')
    assert any("its unit is not a length; a metre is assumed" in w for w in scene("a.dae", unit).warnings)
    other = "<library_geometries><geometry id='h'><spline/></geometry><geometry id='i'><brep/></geometry>"
    found = scene("b.dae", text.replace("<library_geometries>", other))
    assert any("1 splines are left out" in w for w in found.warnings)


def test_parts_of_usd_stages(tmp_path):
    path = tmp_path / "a.usda"
    made = usd_files.stage(path)
    usd_files.mesh(made, "/square", counts=(4, 2), corners=(0, 1, 2, 3, 0, 1))
    for name in ("one", "two"):
        subset = UsdGeom.Subset.Define(made, f"/square/{name}")
        subset.CreateElementTypeAttr("face")
        subset.CreateFamilyNameAttr(UsdShade.Tokens.materialBind)
        subset.CreateIndicesAttr([0, 9])
    UsdGeom.Sphere.Define(made, "/ball").CreateRadiusAttr(0)
    UsdLux.RectLight.Define(made, "/lamp").CreateWidthAttr(0)
    points = UsdGeom.Points.Define(made, "/dust")
    points.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    points.CreateWidthsAttr([1, 0, 1])
    grains = UsdGeom.Points.Define(made, "/grains")
    grains.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    grains.CreateWidthsAttr([1, 1])
    many = UsdGeom.PointInstancer.Define(made, "/many")
    many.CreatePositionsAttr([(0, 0, 0), (1, 0, 0), (float("inf"), 0, 0)])
    many.CreateProtoIndicesAttr([0, 1, 0])
    many.CreatePrototypesRel().SetTargets(["/square", "/gone"])
    made.GetRootLayer().Save()
    sentences = " ".join(usd_files.read(path).warnings)
    for said in (
        "1 faces with fewer than three corners are left out (1): /square",
        "1 faces belong to several subsets; the material of the first subset is used (1): /square/two",
        "1 faces of subsets that are missing in their mesh are left out (2): /square/one, /square/two",
        "Shapes without a size are left out (1): /ball",
        "Lights without an area are left out (1): lamp",
        "1 points without a finite position or a width are left out (1): /dust",
        "Points whose number of widths is wrong are shown with width 1 (1): /grains",
        "1 instances without a prototype or with a position that is not finite are left out (1): /many",
        "Prototypes that are missing in the stage are left out, 1 times (1): /gone",
    ):
        assert said in sentences, (said, sentences)
