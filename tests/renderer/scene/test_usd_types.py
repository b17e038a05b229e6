"""Tests of USD files whose attributes have other types than the schemas define, and of skins with their own joints."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from renderer.errors import SceneError
from renderer.scene.load import read
from tests.renderer.scene.builders import world


def test_unit_stored_as_float_is_read(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usdc"))
    UsdGeom.Cube.Define(stage, "/m")
    UsdGeom.SetStageMetersPerUnit(stage, 0.5)
    stage.GetRootLayer().Save()
    data = (tmp_path / "a.usdc").read_bytes()
    assert data.count(b"\x09\x40") == 1  # an inlined double, stored as the bits of a float
    (tmp_path / "a.usdc").write_bytes(data.replace(b"\x09\x40", b"\x08\x40"))
    description = read(tmp_path, "a.usdc")
    assert np.ptp(world(description)[..., 0]) == pytest.approx(1.0)
    assert "The stage's metersPerUnit is not stored as a double; 0.5 is used." in description.warnings


def test_prims_with_wrong_types_are_omitted_and_counted(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/m")
    for name, kind, key in (("/c", "Camera", "focalLength"), ("/l", "SphereLight", "inputs:radius")):
        stage.DefinePrim(name, kind)
        Sdf.AttributeSpec(stage.GetRootLayer().GetPrimAtPath(name), key, Sdf.ValueTypeNames.String).default = "x"
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    assert len(description.instances) == 1
    said = "Prims that are damaged or have values of wrong types are left out (2): /c, /l."
    assert said in description.warnings


@pytest.mark.parametrize("name", ["focalLength", "verticalAperture"])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_camera_without_a_lens_gets_the_usual_one(tmp_path, name, value):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/m")
    UsdGeom.Camera.Define(stage, "/usual")
    UsdGeom.Camera.Define(stage, "/c").GetPrim().GetAttribute(name).Set(value)
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    usual, found = description.cameras
    assert found.view.fov == pytest.approx(usual.view.fov)
    assert [w for w in description.warnings if "get those of a 50 mm lens (1): c" in w]


def test_positions_of_a_mesh_without_faces_do_not_matter(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/m")
    empty = UsdGeom.Mesh.Define(stage, "/e")
    empty.CreatePointsAttr([(np.nan, 0, 0), (0, 0, 0), (0, 1, 0)])
    empty.CreateFaceVertexCountsAttr([3])
    empty.CreateFaceVertexIndicesAttr([1, 1, 1])
    empty.CreateSubdivisionSchemeAttr("catmullClark")
    stage.GetRootLayer().Save()
    assert np.isfinite(world(read(tmp_path, "a.usda"))).all()


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
@pytest.mark.parametrize("faces", [1, 2])
def test_faces_at_positions_that_are_not_finite_leave_the_rest(tmp_path, scheme, faces):
    """A vertex that is not finite takes the faces that use it, or a mesh of only such faces, out of the scene."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/m")
    odd = UsdGeom.Mesh.Define(stage, "/e")
    odd.CreatePointsAttr([(np.nan, 0, 0), (0, 0, 0), (1, 0, 0), (1, 1, 0)])
    odd.CreateFaceVertexCountsAttr([3] * faces)
    odd.CreateFaceVertexIndicesAttr([0, 1, 2, 1, 2, 3][: 3 * faces])
    odd.CreateSubdivisionSchemeAttr(scheme)
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    assert [len(world(description, i)) for i in range(len(description.instances))] == [12, faces - 1]
    assert any("positions that are not finite" in w for w in description.warnings)


def test_display_opacity_that_is_not_finite_is_left_out(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/m").CreateDisplayOpacityAttr([np.nan])
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    assert [m.opacity for m in description.materials] == [1.0]


@pytest.mark.parametrize("joints", [["b", "a"], ["b"], ["a", "b", "c"]])
def test_skin_with_its_own_joint_list(tmp_path, joints):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdSkel.Root.Define(stage, "/r")
    skeleton = UsdSkel.Skeleton.Define(stage, "/r/s")
    still = Vt.Matrix4dArray([Gf.Matrix4d(1.0)] * 2)
    skeleton.CreateJointsAttr(["a", "b"])
    skeleton.CreateBindTransformsAttr(still)
    skeleton.CreateRestTransformsAttr(still)
    moves = UsdSkel.Animation.Define(stage, "/r/s/anim")
    moves.CreateJointsAttr(["a", "b"])
    moves.CreateTranslationsAttr([(0, 0, 0), (5, 0, 0)])
    moves.CreateRotationsAttr([Gf.Quatf(1, 0, 0, 0)] * 2)
    moves.CreateScalesAttr([(1, 1, 1)] * 2)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(["/r/s/anim"])
    mesh = UsdGeom.Mesh.Define(stage, "/r/m")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreateSubdivisionSchemeAttr("none")
    bound = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    bound.CreateSkeletonRel().SetTargets(["/r/s"])
    bound.CreateJointsAttr(joints)
    bound.CreateJointIndicesPrimvar(False, 1).Set([joints.index("b")] * 3)
    bound.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 3)
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    np.testing.assert_allclose(world(description)[0], [(5, 0, 0), (6, 0, 0), (5, 1, 0)], atol=1e-6)
    assert any("stand still (c)" in w for w in description.warnings) == ("c" in joints)


def test_layer_above_the_folder(tmp_path):
    inner = tmp_path / "scenes"
    inner.mkdir()
    (tmp_path / "x.usda").write_text('#usda 1.0\n(defaultPrim = "m")\ndef Cube "m" {}\n')
    (inner / "a.usda").write_text('#usda 1.0\ndef "a" (references = @../x.usda@) {}\n')
    with pytest.raises(SceneError, match="has no surface: no triangles and no spheres"):
        read(inner, "a.usda")
    description = read(tmp_path, "scenes/a.usda")
    assert len(description.instances) == 1
