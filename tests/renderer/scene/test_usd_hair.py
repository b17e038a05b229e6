"""Tests of hair in USD: its shaders, and curves with these as fibres."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from renderer.scene.animation import Moment
from tests.renderer.scene.usd_files import TYPES, bind, material, read, stage

F, C = TYPES.Float, TYPES.Color3f
DOCUMENT = """<materialx version="1.39">
<chiang_hair_roughness name="rough" type="multioutput"><input name="longitudinal" type="float" value="0.25"/>
<input name="azimuthal" type="float" value="0.4"/></chiang_hair_roughness>
<deon_hair_absorption_from_melanin name="pigment" type="vector3">
<input name="melanin_concentration" type="float" value="0.5"/>
<input name="melanin_redness" type="float" value="0.25"/></deon_hair_absorption_from_melanin>
<chiang_hair_bsdf name="hair" type="BSDF"><input name="roughness_R" type="vector2" nodename="rough" output="roughness_R"/>
<input name="absorption_coefficient" type="vector3" nodename="pigment"/><input name="ior" type="float" value="1.5"/>
<input name="cuticle_angle" type="float" value="0.48"/></chiang_hair_bsdf>
<surface name="s" type="surfaceshader"><input name="bsdf" type="BSDF" nodename="hair"/></surface>
<surfacematerial name="Look" type="material"><input name="surfaceshader" type="surfaceshader" nodename="s"/></surfacematerial>
</materialx>"""


@pytest.fixture
def strands(tmp_path):
    """Returns a function `strands(make)` that reads two strands with the material made by `make(stage)`.

    It returns (scene, material, mesh).
    """

    def make_scene(make):
        made = stage(tmp_path / "a.usda")
        curves = UsdGeom.BasisCurves.Define(made, "/c")
        curves.CreateTypeAttr("linear")
        curves.CreateCurveVertexCountsAttr([3, 2])
        curves.CreatePointsAttr([(x, 0, k) for k, count in ((0, 3), (1, 2)) for x in range(count)])
        curves.CreateWidthsAttr([0.2, 0.1])
        UsdGeom.PrimvarsAPI(curves).CreatePrimvar("st", TYPES.TexCoord2fArray, "uniform").Set([(0.25, 0.5), (0.75, 0.125)])
        UsdGeom.PrimvarsAPI(curves).CreatePrimvar("widths", TYPES.FloatArray, "uniform").Set([0.2, 0.1])
        bind(curves, make(made))
        made.GetRootLayer().Save()
        found = read(tmp_path / "a.usda")
        mesh = found.meshes[0]
        return found, found.materials[mesh.material], mesh

    return make_scene


def test_materialx_hair_makes_fibres(strands, tmp_path):
    """Curves whose surface is MaterialX's hair are fibres with its roughness, its pigments' absorption and its scales' tilt."""
    (tmp_path / "looks.mtlx").write_text(DOCUMENT)

    def look(made):
        look = UsdShade.Material.Define(made, "/look")
        look.GetPrim().GetReferences().AddReference("looks.mtlx", Sdf.Path("/MaterialX/Materials/Look"))
        return look

    found, hair, mesh = strands(look)
    assert (hair.kind, hair.beta_m, hair.beta_n, hair.ior) == ("hair", *map(pytest.approx, (0.25, 0.4, 1.5)))
    assert math.degrees(hair.tilt) == pytest.approx(3.6)
    pigments = 0.75 * np.array((0.419, 0.697, 1.37)) + 0.25 * np.array((0.187, 0.4, 1.05))
    np.testing.assert_allclose(hair.sigma_a, math.log(2) * pigments, rtol=1e-4)
    np.testing.assert_allclose(mesh.tangents, [(1, 0, 0, 1)] * len(mesh.positions), atol=1e-6)
    widths = np.where(mesh.positions[:, 2] < 0.5, 0.2, 0.1)
    np.testing.assert_allclose(mesh.diameters, widths, rtol=1e-5)
    assert not any("air" in warning for warning in found.warnings)


def test_hair_shaders_of_stages(strands, tmp_path, png):
    """A hair BSDF by variances and Arnold's hair are read; a picture gives each strand the colour at its root."""

    def chiang(made):
        look, surface = material(made, "/look", "ND_surface", "mtlx")
        hair = UsdShade.Shader.Define(made, "/look/hair")
        hair.CreateIdAttr("ND_chiang_hair_bsdf")
        spread, scale = 0.726 * 0.3 + 0.812 * 0.3**2, 0.265 * 0.5 + 1.194 * 0.5**2 + 5.372 * 0.5**22
        hair.CreateInput("roughness_R", TYPES.Float2).Set(Gf.Vec2f(spread**2, scale))
        hair.CreateInput("absorption_coefficient", TYPES.Float3).Set(Gf.Vec3f(0.5, 1, 2))
        surface.CreateInput("bsdf", TYPES.Token).ConnectToSource(hair.CreateOutput("out", TYPES.Token))
        return look

    _, hair, _ = strands(chiang)
    assert (hair.kind, hair.beta_m, hair.beta_n, hair.tilt) == ("hair", *(pytest.approx(v, abs=1e-3) for v in (0.3, 0.5, 0)))
    np.testing.assert_allclose(hair.sigma_a, (0.5, 1, 2), rtol=1e-5)

    (tmp_path / "t.png").write_bytes(png(200, 100, 50))

    def arnold(made):
        picture = UsdShade.Shader.Define(made, "/look/picture")
        picture.CreateIdAttr("arnold:image")
        picture.CreateInput("filename", TYPES.String).Set("t.png")
        given = {"base_color": (C, picture.CreateOutput("out", TYPES.Color4f)), "melanin": (F, 0.0), "roughness": (F, 0.35)}
        return material(made, "/look", "arnold:standard_hair", "arnold", **given)[0]

    found, hair, mesh = strands(arnold)
    assert (hair.kind, hair.beta_m, hair.beta_n, math.degrees(hair.tilt)) == ("hair", *map(pytest.approx, (0.35, 0.35, -3)))
    assert found.images[found.textures[hair.base_color_texture].image].pixels[0, 0, :3].tolist() == [200, 100, 50]
    roots = np.where(mesh.positions[:, 2:] < 0.5, (0.25, 0.5), (0.75, 0.875))
    np.testing.assert_allclose(mesh.uvs, roots)
    _, black, _ = strands(lambda made: material(made, "/look", "arnold:standard_hair", "arnold")[0])
    assert min(black.sigma_a) > 3


def test_moving_hair_keeps_its_vertices(tmp_path):
    """Hair that bends over time has as many vertices at all times, which motion blur needs."""
    made = stage(tmp_path / "a.usda")
    curves = UsdGeom.BasisCurves.Define(made, "/c")
    curves.CreateTypeAttr("cubic")
    curves.CreateBasisAttr("bspline")
    curves.CreateCurveVertexCountsAttr([5])
    for frame, bend in ((0, 0), (10, 3)):
        curves.CreatePointsAttr().Set([(k, bend * (k % 2), 0) for k in range(5)], frame)
    curves.CreateWidthsAttr([0.01])
    curves.SetWidthsInterpolation("constant")
    bind(curves, material(made, "/look", "arnold:standard_hair", "arnold")[0])
    made.GetRootLayer().Save()
    sizes = [len(read(tmp_path / "a.usda", Moment(frame)).meshes[0].positions) for frame in (0, 10)]
    assert sizes[0] == sizes[1] == 13
    curves.GetPointsAttr().Clear()
    curves.CreatePointsAttr([(k, 0, 0) for k in range(5)])
    made.GetRootLayer().Save()
    assert len(read(tmp_path / "a.usda").meshes[0].positions) == 3
