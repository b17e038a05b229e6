"""Tests of USD stages that refer to MaterialX documents: their materials are shown, and damaged documents are named."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.test_usd_materials import linear, seen
from tests.renderer.scene.usd_files import MTLX, TYPES, bind, mesh, read, stage

INNER = """<materialx version="1.38"><open_pbr_surface name="os" type="surfaceshader">
<input name="base_color" type="color3" value="0.1, 0.2, 0.3"/></open_pbr_surface>
<surfacematerial name="Inner" type="material"><input name="surfaceshader" type="surfaceshader" nodename="os"/></surfacematerial>
</materialx>"""
INCLUDE = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{}"/>'


@pytest.fixture
def shown(tmp_path, png):
    """Returns a function `shown(document, name)` that reads a square with a material of the document."""

    def make(document, name="Look"):
        (tmp_path / "maps").mkdir(exist_ok=True)
        (tmp_path / "maps" / "t.png").write_bytes(png(200, 100, 50))
        (tmp_path / "looks.mtlx").write_text(document)
        made = stage(tmp_path / "a.usda")
        square = mesh(made, "/m")
        UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set([(0, 0), (1, 0), (1, 1), (0, 1)])
        look = UsdShade.Material.Define(made, "/look")
        look.GetPrim().GetReferences().AddReference("looks.mtlx", Sdf.Path(f"/MaterialX/Materials/{name}"))
        bind(square, look)
        made.GetRootLayer().Save()
        found = read(tmp_path / "a.usda")
        return found, found.materials[found.meshes[0].material]

    return make


def test_materialx_document_materials(shown):
    found, look = shown(MTLX % "")
    got = [seen(found, look.base_color_texture, k) * look.base_color[k] for k in range(3)]
    np.testing.assert_allclose(got, [0.5 * linear(c) for c in (200, 100, 50)], atol=0.004)
    a, b, _, c, d, _ = found.textures[look.base_color_texture].transform
    np.testing.assert_allclose((a, b, c, d), (2, 0, 0, 3))
    np.testing.assert_allclose(look.emission, [linear(255 * c) for c in (0.5, 0.25, 1)], rtol=1e-5)
    assert seen(found, look.metallic_roughness_texture, 1) == pytest.approx(linear(100), abs=0.004)
    assert (look.ior, look.metallic, look.thin) == (pytest.approx(1.7), pytest.approx(0.75), False)
    assert not found.warnings or not any("MaterialX" in w or "layer" in w for w in found.warnings)


def test_included_and_missing_documents(shown, tmp_path):
    (tmp_path / "inner.mtlx").write_text(INNER)
    found, look = shown(MTLX % (INCLUDE.format("inner.mtlx") + INCLUDE.format("gone.mtlx")), "Inner")
    np.testing.assert_allclose(look.base_color, (0.1, 0.2, 0.3), rtol=1e-5)
    assert any("gone.mtlx" in w for w in found.warnings)


@pytest.mark.parametrize(
    "document",
    [
        "<materialx",
        "<other/>",
        '<!DOCTYPE a [<!ENTITY b "c">]><materialx/>',
        MTLX.replace('value="0.5"', 'value="half"') % INCLUDE.format("looks.mtlx"),
    ],
)
def test_damaged_documents_are_named(shown, document):
    found, _ = shown(document)
    assert len(found.meshes) == 1
    assert found.warnings


def test_recursive_node_terminates(shown):
    found, look = shown(MTLX.replace('nodename="picture"', 'nodename="product"') % "")
    assert len(found.meshes) == 1
    assert look.base_color_texture is None


def test_baked_images_are_cached_between_frames(shown, tmp_path):
    shown(MTLX.replace("<multiply", "<power").replace("</multiply", "</power") % "")
    made = Usd.Stage.Open(str(tmp_path / "a.usda"))
    lift = UsdGeom.Xformable(made.GetPrimAtPath("/m")).AddTranslateOp()
    for time in (0, 10):
        lift.Set(Gf.Vec3d(time, 0, 0), time)
    made.GetRootLayer().Save()
    shot = Shot(tmp_path, "a.usda")
    pictures = []
    for frame in (0, 1):
        found = shot.scene_at(Moment(frame))
        texture = found.materials[found.meshes[0].material].base_color_texture
        pictures.append(found.images[found.textures[texture].image])
    assert pictures[0].name.endswith("with others")
    assert pictures[0].pixels is pictures[1].pixels


def test_document_displacement(shown):
    document = """<materialx version="1.39"><standard_surface name="s" type="surfaceshader"/>
<image name="h" type="float"><input name="file" type="filename" value="maps/t.png"/></image>
<displacement name="d" type="displacementshader"><input name="displacement" type="float" nodename="h"/>
<input name="scale" type="float" value="0.1"/></displacement>
<surfacematerial name="Look" type="material"><input name="surfaceshader" type="surfaceshader" nodename="s"/>
<input name="displacementshader" type="displacementshader" nodename="d"/></surfacematerial></materialx>"""
    found, look = shown(document)
    assert look.displacement_texture is not None
    assert look.displacement_scale == pytest.approx(0.1)
    assert not any("isplacement" in warning for warning in found.warnings)
