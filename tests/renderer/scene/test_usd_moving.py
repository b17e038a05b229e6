"""Tests of USD: time samples, skeletons and blend shapes, against usd-core's own values at a time."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdSkel, Vt

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.usd_files import cube, read, stage, world


def test_frames_start_at_the_stage_start(tmp_path):
    made = stage(tmp_path / "a.usda")
    made.SetStartTimeCode(101)
    made.SetEndTimeCode(141)
    made.SetTimeCodesPerSecond(40)
    made.SetFramesPerSecond(20)
    box = cube(made, "/m")
    place = box.AddTranslateOp()
    for time, x in ((101, 0.0), (121, 10.0), (141, 30.0)):
        place.Set(Gf.Vec3d(x, 0, 0), time)
    cube(made, "/still")
    seen = cube(made, "/sometimes")
    for time, token in ((101, "inherited"), (121, "invisible")):
        seen.CreateVisibilityAttr().Set(token, time)
    bends = cube(made, "/bends")
    points = np.array(bends.GetPointsAttr().Get())
    bends.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 101)
    bends.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points * 3), 141)
    camera = UsdGeom.Camera.Define(made, "/c")
    for time, length in ((101, 20.0), (141, 40.0)):
        camera.CreateFocalLengthAttr().Set(length, time)
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 9))
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    light = UsdLux.DistantLight.Define(made, "/l")
    light.CreateAngleAttr(0.0)
    for time, strength in ((101, 1.0), (141, 3.0)):
        light.CreateIntensityAttr().Set(strength, time)
    made.GetRootLayer().Save()

    first = read(tmp_path / "a.usda")
    assert (first.fps, first.moves, first.defaults["shutter"]) == (20, True, 0.5)
    assert [(c.start, c.end) for c in first.clips] == [(0, 1)]
    shot = Shot(tmp_path, "a.usda")
    for frame in (0, 5, 10, 15, 30):
        time = min(101 + frame * 2, 141)
        found = shot.scene_at(Moment(frame))
        named = {i.name: i for i in found.instances}
        own = UsdGeom.Xformable(box).ComputeLocalToWorldTransform(time).ExtractTranslation()
        np.testing.assert_allclose(named["m"].transform[:3, 3], own, atol=1e-6)
        assert ("sometimes" in named) == (time < 121)
        shape = found.meshes[named["bends"].mesh]
        np.testing.assert_allclose(shape.positions, bends.GetPointsAttr().Get(time), atol=1e-6)
        assert found.cameras[0].view.fov == pytest.approx(camera.GetCamera(time).GetFieldOfView(Gf.Camera.FOVVertical), abs=1e-4)
        assert found.lights[0].intensity[0] == pytest.approx(light.GetIntensityAttr().Get(time))
        assert [named[n].moves for n in ("m", "still")] == [True, False]
        assert (shape.deforms, found.meshes[named["still"].mesh].deforms) == (True, False)
    blurred = shot.over_shutter(Moment(5))
    assert blurred.keys > 0
    assert len({float(k[0, 3]) for k in blurred.instances[0].keys}) == blurred.keys
    with pytest.raises(SceneError, match="has no clip 'walk'"):
        read(tmp_path / "a.usda", Moment(clip="walk"))


def test_splines_are_evaluated(tmp_path):
    """Spline keys, which are not time samples, are animation too."""
    from pxr import Ts

    made = stage(tmp_path / "a.usda")
    made.SetTimeCodesPerSecond(24)
    turn = cube(made, "/m").AddRotateYOp()
    spline = Ts.Spline("float")
    for time, value in ((1, 0.0), (25, 90.0)):
        knot = Ts.Knot("float")
        knot.SetTime(time)
        knot.SetValue(value)
        knot.SetNextInterpolation(Ts.InterpLinear)
        spline.SetKnot(knot)
    turn.GetAttr().SetSpline(spline)
    made.GetRootLayer().Save()
    shot = Shot(tmp_path, "a.usda")
    first = shot.scene_at(Moment(0))
    assert (first.moves, [(c.start, c.end) for c in first.clips]) == (True, [(0, 1)])
    for frame in (0, 6, 12, 24):
        own = np.array(UsdGeom.Xformable(made.GetPrimAtPath("/m")).ComputeLocalToWorldTransform(1 + frame)).T
        np.testing.assert_allclose(shot.scene_at(Moment(frame)).instances[0].transform, own, atol=1e-6)


def arm(path):
    """Writes a stage with a mesh on a skeleton of two bending joints and one with blend shapes, below a moved root."""
    made = stage(path, "Z", 0.01)
    made.SetStartTimeCode(0)
    made.SetEndTimeCode(10)
    root = UsdSkel.Root.Define(made, "/root")
    UsdGeom.Xformable(root).AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    skeleton = UsdSkel.Skeleton.Define(made, "/root/skeleton")
    UsdGeom.Xformable(skeleton).AddRotateZOp().Set(30.0)
    skeleton.CreateJointsAttr(["a", "a/b"])
    rest = [Gf.Matrix4d(1), Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0, 1))]
    skeleton.CreateBindTransformsAttr(rest)
    skeleton.CreateRestTransformsAttr(rest)
    animation = UsdSkel.Animation.Define(made, "/root/animation")
    animation.CreateJointsAttr(["a", "a/b"])
    animation.CreateTranslationsAttr([Gf.Vec3f(0), Gf.Vec3f(0, 0, 1)])
    animation.CreateScalesAttr([Gf.Vec3h(1), Gf.Vec3h(1, 1, 1.5)])
    for time, angle in ((0, 0), (10, 90)):
        turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(1, 0, 0), angle).GetQuat())
        animation.CreateRotationsAttr().Set([Gf.Quatf(1), turn], time)
    animation.CreateBlendShapesAttr(["wide", "high"])
    animation.CreateBlendShapeWeightsAttr().Set([0.0, 1.0], 0)
    animation.CreateBlendShapeWeightsAttr().Set([1.0, 0.25], 10)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    for name, has_joints, has_shapes in (("both", True, True), ("joints", True, False), ("shapes", False, True)):
        box = cube(made, f"/root/{name}")
        UsdGeom.Xformable(box).AddTranslateOp().Set(Gf.Vec3d(3, 0, 0))
        normals = UsdGeom.PrimvarsAPI(box).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "uniform")
        normals.Set([(0, 0, -1), (0, 0, 1), (0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0)])
        binding = UsdSkel.BindingAPI.Apply(box.GetPrim())
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        if has_joints:
            weights = [w for z in (0.9, 0.9, 0.6, 0.9, 0.25, 0.25, 0.0, 0.4) for w in (z, 1 - z)]
            binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 8)
            binding.CreateJointWeightsPrimvar(False, 2).Set(weights)
            binding.CreateGeomBindTransformAttr(Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0.5, 0)))
        if has_shapes:
            for shape, offsets, which in (("wide", [(1, 0, 0)] * 8, None), ("high", [(0, 0, 2), (0, 1, 2)], [4, 6])):
                blend = UsdSkel.BlendShape.Define(made, f"/root/{name}/{shape}")
                blend.CreateOffsetsAttr(offsets)
                if which:
                    blend.CreatePointIndicesAttr(which)
            binding.CreateBlendShapesAttr(["wide", "high"])
            binding.CreateBlendShapeTargetsRel().SetTargets([f"/root/{name}/{s}" for s in ("wide", "high")])
    made.GetRootLayer().Save()
    return made


def test_skeletons_and_blend_shapes_match_usd_baking(tmp_path):
    made = arm(tmp_path / "a.usda")
    shot = Shot(tmp_path, "a.usda")
    scenes = {frame: shot.scene_at(Moment(frame)) for frame in (0, 4, 10)}
    assert UsdSkel.BakeSkinning(made.Traverse())
    turned = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) * 0.01
    for frame, found in scenes.items():
        assert all(found.meshes[i.mesh].deforms for i in found.instances)
        for number, name in enumerate(("both", "joints", "shapes")):
            prim = UsdGeom.Mesh.Get(made, f"/root/{name}")
            place = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(frame))
            baked = np.array(prim.GetPointsAttr().Get(frame)) @ place[:3, :3] + place[3, :3]
            want = (baked @ turned.T)[np.array(prim.GetFaceVertexIndicesAttr().Get())]
            got = world(found, number).reshape(-1, 3)
            assert np.linalg.norm(want[:, None] - got[None], axis=2).min(axis=1).max() < 1e-6, (frame, name)
    cubes = scenes[0].meshes[scenes[0].instances[2].mesh]
    assert cubes.normals is not None


@pytest.mark.parametrize("hidden", ["purpose", "visibility"])
def test_hidden_skeleton_places_its_meshes(tmp_path, hidden):
    made = arm(tmp_path / "a.usda")
    shown = world(read(tmp_path / "a.usda"), 0)
    for prim in made.Traverse():
        if prim.IsA(UsdSkel.Skeleton):
            if hidden == "purpose":
                UsdGeom.Imageable(prim).CreatePurposeAttr("guide")
            else:
                UsdGeom.Imageable(prim).CreateVisibilityAttr("invisible")
    made.GetRootLayer().Save()
    np.testing.assert_array_equal(world(read(tmp_path / "a.usda"), 0), shown)


def test_skin_moves_while_the_shutter_is_open(tmp_path):
    arm(tmp_path / "a.usda")
    moving = Shot(tmp_path, "a.usda").over_shutter(Moment(3), {"shutter": 0.5})
    assert all(len(moving.meshes[i.mesh].keys) == moving.keys > 0 for i in moving.instances)


def test_static_prims_are_read_once(tmp_path):
    made = stage(tmp_path / "a.usda")
    place = cube(made, "/m").AddTranslateOp()
    for time in (0, 5):
        place.Set(Gf.Vec3d(time, 0, 0), time)
    made.GetRootLayer().Save()
    shot = Shot(tmp_path, "a.usda")
    one, other = shot.scene_at(Moment(0)), shot.scene_at(Moment(3))
    assert one.meshes[0].positions is other.meshes[0].positions


def test_unsupported_shutters_and_blend_shapes_are_named(tmp_path):
    made = arm(tmp_path / "a.usda")
    UsdSkel.BlendShape.Get(made, "/root/shapes/wide").CreateNormalOffsetsAttr([(0, 0, 1)] * 8)
    camera = UsdGeom.Camera.Define(made, "/root/eye")
    camera.CreateShutterOpenAttr(0.0)
    camera.CreateShutterCloseAttr(0.5)
    made.GetRootLayer().Save()
    found = Shot(tmp_path, "a.usda").scene_at()
    assert found.defaults["shutter"] == 0.5
    assert any("Shutters that are not centred" in w for w in found.warnings)
    assert any("Normals are not changed by blend shapes" in w for w in found.warnings)
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    made.GetRootLayer().Save()
    assert not any("Shutters" in w for w in Shot(tmp_path, "a.usda").scene_at().warnings)
