"""Tests of USD: meshes, transforms, instances and cameras, against usd-core's own results."""

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdPhysics, UsdRender, UsdShade, Vt

from renderer.errors import SceneError
from tests.renderer.scene.usd_files import CUBE, SQUARE, TYPES, bind, cube, material, mesh, ours, read, stage, texture, world


@pytest.mark.parametrize(("suffix", "up", "unit"), [("usda", "Y", 1.0), ("usdc", "Z", 0.01), ("usd", "Z", 2.54)])
def test_usd_meshes_match_usd_bounds(tmp_path, suffix, up, unit):
    made = stage(tmp_path / f"a.{suffix}", up, unit)
    rng = np.random.default_rng(3)
    path = ""
    for k in range(4):
        path += f"/x{k}"
        xform = UsdGeom.Xform.Define(made, path)
        xform.AddTranslateOp().Set(Gf.Vec3d(*rng.normal(size=3)))
        xform.AddRotateXYZOp().Set(Gf.Vec3f(*(rng.normal(size=3) * 90)))
        xform.AddScaleOp().Set(Gf.Vec3f(*rng.uniform(0.5, 2, 3)))
        cube(made, f"{path}/m")
    apart = cube(made, f"{path}/apart")
    apart.AddTranslateOp().Set(Gf.Vec3d(7, 8, 9))
    apart.SetResetXformStack(True)
    made.GetRootLayer().Save()
    found = read(tmp_path / f"a.{suffix}")
    cache = UsdGeom.BBoxCache(0, ["default"])
    prims = [p for p in made.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert len(found.instances) == len(prims) == 5
    for i, prim in enumerate(prims):
        box = cache.ComputeWorldBound(prim)
        corners = np.array([ours(made, box.GetMatrix().Transform(Gf.Vec3d(*box.GetRange().GetCorner(k)))) for k in range(8)])
        got = np.unique(np.round(world(found, i).reshape(-1, 3), 6), axis=0)
        nearest = np.linalg.norm(corners[:, None] - got[None], axis=2).min(axis=1)
        assert nearest.max() < 1e-4 * unit * 10


def test_polygon_faces_keep_area_and_orientation(tmp_path):
    made = stage(tmp_path / "a.usda")
    arrow = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0)]  # concave
    dart = [(5, 0, 0), (6, 0.2, 0), (5.1, 0.1, 0), (5.2, 1, 0)]
    mesh(made, "/m", [*arrow, *dart, (9, 0, 0)], [5, 4, 3, 2], [0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 1, 3, 0, 1])
    left = mesh(made, "/left")
    left.CreateOrientationAttr("leftHanded")
    holes = cube(made, "/holes")
    holes.CreateHoleIndicesAttr([0, 3])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")

    def up(number):
        a, b, c = np.moveaxis(world(found, number), 1, 0)
        return np.cross(b - a, c - a)[:, 2] / 2

    shoelace = sum(
        0.5 * (x0 * y1 - x1 * y0)
        for p in (arrow, dart, [arrow[k] for k in (0, 1, 3)])
        for (x0, y0, _), (x1, y1, _) in zip(p, p[1:] + p[:1], strict=True)
    )
    assert up(0).sum() == pytest.approx(shoelace, abs=1e-5)
    assert (up(0) >= 0).all()
    assert up(1).sum() == pytest.approx(-1)
    assert len(world(found, 2)) == 8


VALUES = {
    "constant": ([(0.25, 0.5)], None),
    "uniform": ([(0.1, 0.2), (0.3, 0.4)], None),
    "vertex": ([(k / 8, k / 16) for k in range(6)], None),
    "varying": ([(k / 8, k / 16) for k in range(6)], None),
    "faceVarying": ([(0, 0), (1, 0), (0.5, 1), (0.25, 0.75)], [0, 1, 2, 3, 0, 3, 2, 1]),
}


@pytest.mark.parametrize("interpolation", VALUES)
def test_primvar_interpolations(tmp_path, png, interpolation):
    made = stage(tmp_path / "a.usda")
    strip = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
    corners = [0, 1, 4, 3, 1, 2, 5, 4]
    grid = mesh(made, "/m", strip, [4, 4], corners)
    values, indices = VALUES[interpolation]
    primvar = UsdGeom.PrimvarsAPI(grid).CreatePrimvar("st", TYPES.TexCoord2fArray, interpolation)
    primvar.Set(values)
    if indices:
        primvar.SetIndices(Vt.IntArray(indices))
    UsdGeom.PrimvarsAPI(grid).CreatePrimvar("normals", TYPES.Normal3fArray, "uniform").Set([(0, 0, 1), (0, 1, 0)])
    bind(grid, material(made, "/look", diffuseColor=(TYPES.Color3f, texture(made, "/look/t", "t.png")))[0])
    (tmp_path / "t.png").write_bytes(png(1, 2, 3))
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda").meshes[0]
    flat = primvar.ComputeFlattened()
    place = {"constant": lambda c: 0, "uniform": lambda c: c // 4, "faceVarying": lambda c: c}
    for c, point in enumerate(corners):
        s, t = flat[place.get(interpolation, lambda c: corners[c])(c)]
        is_here = (found.positions == np.float32(strip[point])).all(axis=1)
        is_here &= (found.normals == ((0, 0, 1) if c < 4 else (0, 1, 0))).all(axis=1)
        assert any(np.allclose(found.uvs[k], (s, 1 - t), atol=1e-6) for k in np.flatnonzero(is_here)), (c, s, t)
    assert len(found.triangles) == 4


def test_face_subsets_have_own_materials(tmp_path):
    made = stage(tmp_path / "a.usda")
    box = cube(made, "/m")
    for name, faces in (("a", [0, 1]), ("b", [2])):
        subset = UsdGeom.Subset.CreateGeomSubset(box, name, "face", Vt.IntArray(faces), "materialBind")
        bind(subset, material(made, f"/{name}", roughness=(TYPES.Float, 0.25))[0])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    shown = {found.materials[found.meshes[i.mesh].material].name: len(found.meshes[i.mesh].triangles) for i in found.instances}
    assert shown == {"default": 6, "a": 4, "b": 2}
    assert len({i.name for i in found.instances}) == 1


def test_hidden_and_guide_prims_are_omitted(tmp_path):
    made = stage(tmp_path / "a.usda")
    for name, purpose in (("seen", "render"), ("guide", "guide"), ("proxy", "proxy")):
        UsdGeom.Imageable(cube(made, f"/{name}")).CreatePurposeAttr(purpose)
    UsdGeom.Xform.Define(made, "/dark").MakeInvisible()
    cube(made, "/dark/m")
    made.CreateClassPrim("/_class")
    cube(made, "/_class/m")
    made.GetRootLayer().Save()
    assert [i.name for i in read(tmp_path / "a.usda").instances] == ["seen"]


def test_instances_of_one_prototype_share_its_mesh(tmp_path):
    made = stage(tmp_path / "a.usda")
    inner = stage(tmp_path / "tree.usda")
    inner.SetDefaultPrim(UsdGeom.Xform.Define(inner, "/tree").GetPrim())
    cube(inner, "/tree/leaf").AddTranslateOp().Set(Gf.Vec3d(0, 2, 0))
    inner.GetRootLayer().Save()
    for k in range(3):
        one = UsdGeom.Xform.Define(made, f"/t{k}")
        one.AddTranslateOp().Set(Gf.Vec3d(k, 0, 0))
        one.GetPrim().GetReferences().AddReference("./tree.usda")
        one.GetPrim().SetInstanceable(True)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert len(made.GetPrototypes()) == len(found.meshes) == 1
    assert [i.transform[:3, 3].tolist() for i in found.instances] == [[0, 2, 0], [1, 2, 0], [2, 2, 0]]


def test_equal_shapes_and_references_share_a_mesh(tmp_path):
    made = stage(tmp_path / "a.usda")
    made.DefinePrim("/a", "Cylinder")
    for k in range(3):
        made.DefinePrim(f"/b{k}").GetReferences().AddInternalReference("/a")
    made.DefinePrim("/c", "Cylinder").GetAttribute("height").Set(5.0)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert (len(found.meshes), len(found.instances)) == (2, 5)
    assert not any("among the files" in w for w in found.warnings)


def test_point_instancer_transforms(tmp_path):
    made = stage(tmp_path / "a.usda", "Z", 0.1)
    rng = np.random.default_rng(5)
    instancer = UsdGeom.PointInstancer.Define(made, "/i")
    instancer.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    for k in range(2):
        cube(made, f"/i/p{k}").AddScaleOp().Set(Gf.Vec3f(1, 2, 3))
    instancer.CreatePrototypesRel().SetTargets(["/i/p0", "/i/p1"])
    instancer.CreateProtoIndicesAttr([0, 1, 1, 0, 1])
    instancer.CreatePositionsAttr([Gf.Vec3f(*map(float, p)) for p in rng.normal(size=(5, 3))])
    instancer.CreateOrientationsAttr([Gf.Quath(*map(float, q / np.linalg.norm(q))) for q in rng.normal(size=(5, 4))])
    instancer.CreateScalesAttr([Gf.Vec3f(*map(float, s)) for s in rng.uniform(0.5, 2, (5, 3))])
    instancer.CreateInvisibleIdsAttr([2])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    given = instancer.ComputeInstanceTransformsAtTime(0, 0, applyMask=UsdGeom.PointInstancer.IgnoreMask)
    places = [np.array(given[k] * UsdGeom.Xformable(instancer).ComputeLocalToWorldTransform(0)) for k in (0, 3, 1, 4)]
    assert len(found.instances) == 4
    for number, place in enumerate(places):
        corners = {tuple(np.round(ours(made, (*p, 1) @ place[:, :3]), 4)) for p in CUBE}
        assert {tuple(np.round(p, 4)) for p in world(found, number).reshape(-1, 3)} == corners


@pytest.mark.parametrize("word", ["def", "over", "class"])
def test_prototypes_are_shown_by_their_instancer_only(word, tmp_path):
    (tmp_path / "a.usda").write_text(
        f"""#usda 1.0
(
    metersPerUnit = 1
)
def PointInstancer "i" {{
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (3, 0, 0)]
    rel prototypes = [</{"i/" if word != "class" else ""}kinds/a>]
    {'def "kinds" { def Xform "a" { def Sphere "ball" {' if word == "def" else ""}
    {'over "kinds" { def Xform "a" { def Sphere "ball" {' if word == "over" else ""}
    {"}}}" if word != "class" else ""}
}}
{'class "kinds" { def Xform "a" { def Sphere "ball" {' if word == "class" else ""}
{"}}}" if word == "class" else ""}
""".replace("}", "\n}\n").replace("{", "{\n")
    )
    found = read(tmp_path / "a.usda")
    assert sorted(instance.transform[0, 3] for instance in found.instances) == [0, 3]


def test_usd_camera_matches_usd_core(tmp_path):
    made = stage(tmp_path / "a.usda", "Z", 0.01)
    cube(made, "/m")
    lens = UsdGeom.Camera.Define(made, "/lens")
    place = Gf.Matrix4d().SetLookAt(Gf.Vec3d(50, -80, 30), Gf.Vec3d(1, 2, 3), Gf.Vec3d(0, 0, 1)).GetInverse()
    lens.AddTransformOp().Set(place)
    lens.CreateFocalLengthAttr(35.0)
    lens.CreateVerticalApertureAttr(20.25)
    lens.CreateFStopAttr(2.8)
    lens.CreateHorizontalApertureOffsetAttr(1.5)
    lens.CreateVerticalApertureOffsetAttr(-4.0)
    lens.CreateFocusDistanceAttr(80.0)
    flat = UsdGeom.Camera.Define(made, "/flat")
    flat.CreateProjectionAttr("orthographic")
    flat.CreateVerticalApertureAttr(40.0)
    flat.CreateHorizontalApertureOffsetAttr(2.0)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    frustum = lens.GetCamera(0).frustum
    view = found.cameras[0].view
    assert [c.name for c in found.cameras] == ["lens", "flat"]
    np.testing.assert_allclose(view.eye, ours(made, frustum.GetPosition()), atol=1e-4)
    forward = np.subtract(view.target, view.eye)
    np.testing.assert_allclose(forward / np.linalg.norm(forward), ours(made, frustum.ComputeViewDirection()) * 100, atol=1e-4)
    np.testing.assert_allclose(view.up, ours(made, frustum.ComputeUpVector()) * 100, atol=1e-4)
    assert view.fov == pytest.approx(lens.GetCamera(0).GetFieldOfView(Gf.Camera.FOVVertical), abs=1e-4)
    assert view.aperture == pytest.approx(3.5 / (2 * 2.8) * 0.01)  # apertures are in tenths of a unit: 35 is 3.5 cm
    assert view.focus == pytest.approx(0.8)
    window = flat.GetCamera(0).frustum.GetWindow()
    assert found.cameras[1].view.height == pytest.approx(window.GetSize()[1] * 0.01, abs=1e-6)
    middle = window.GetMidpoint() / window.GetSize()[1]
    assert (found.cameras[1].view.shift_x, found.cameras[1].view.shift_y) == pytest.approx(tuple(middle), abs=1e-6)
    window = lens.GetCamera(0).frustum.GetWindow()
    middle = window.GetMidpoint() / window.GetSize()[1]
    assert abs(middle[0]) > 0.05
    assert (view.shift_x, view.shift_y) == pytest.approx(tuple(middle), abs=1e-6)


def test_analytic_shapes_have_usd_extents(tmp_path):
    made = stage(tmp_path / "a.usda")
    for kind in ("Cube", "Cylinder", "Cone", "Capsule", "Plane", "Sphere"):
        for axis in "XYZ":
            prim = made.DefinePrim(f"/{kind}{axis}", kind)
            for name, value in (("radius", 0.5), ("height", 3.0), ("size", 1.5), ("width", 2.0), ("length", 4.0), ("axis", axis)):
                if prim.GetAttribute(name):
                    prim.GetAttribute(name).Set(value)
            if kind == "Sphere":  # under a non-uniform scale
                UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(1, 2, 1))
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    cache = UsdGeom.BBoxCache(0, ["default"])
    prims = [p for p in made.Traverse() if p.IsA(UsdGeom.Gprim)]
    for number, prim in enumerate(prims):
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        corners = world(found, number).reshape(-1, 3)
        np.testing.assert_allclose(corners.min(axis=0), box.GetMin(), atol=1e-3)
        np.testing.assert_allclose(corners.max(axis=0), box.GetMax(), atol=1e-3)
        if prim.GetTypeName() != "Plane":  # closed shapes face outwards
            a, b, c = np.moveaxis(world(found, number), 1, 0)
            assert (np.cross(b - a, c - a) * a).sum() > 0


def test_unsupported_prims_share_one_counted_warning(tmp_path):
    made = stage(tmp_path / "a.usda")
    cube(made, "/m")
    for k in range(5):
        made.DefinePrim(f"/v{k}", "Volume")
    mesh(made, "/broken", SQUARE, [4], [0, 1, 2, 9])
    made.GetRootLayer().Save()
    warnings = read(tmp_path / "a.usda").warnings
    assert "Prims of the type Volume are left out (5): /v0, /v1, /v2 and others." in warnings
    assert any(w.startswith("Meshes with damaged faces are left out (1): /broken") for w in warnings)


def test_missing_usd_core_error_names_the_package(tmp_path, monkeypatch):
    import sys

    made = stage(tmp_path / "a.usda")
    cube(made, "/m")
    made.GetRootLayer().Save()
    monkeypatch.setitem(sys.modules, "renderer.scene.readers.usd.reader", None)
    with pytest.raises(SceneError, match="pip install usd-core"):
        read(tmp_path / "a.usda")


def test_usd_variants_are_listed_and_selected(tmp_path):
    made = stage(tmp_path / "a.usda")
    root = UsdGeom.Xform.Define(made, "/root").GetPrim()
    made.SetDefaultPrim(root)
    sets = root.GetVariantSets().AddVariantSet("size")
    for name, length in (("small", 1), ("large", 5)):
        sets.AddVariant(name)
        sets.SetVariantSelection(name)
        with sets.GetVariantEditContext():
            cube(made, "/root/m").AddScaleOp().Set(Gf.Vec3f(length, length, length))
    sets.SetVariantSelection("small")
    made.GetRootLayer().Save()
    assert world(read(tmp_path / "a.usda")).max() == 1
    chosen = read(tmp_path / "a.usda", variant="size=large")
    assert chosen.variants == ["size=large", "size=small"]
    assert world(chosen).max() == 5


def test_damaged_usd_error_has_no_machine_path(tmp_path):
    texts = [b'#usda 1.0\ndef Mesh "a" { what', b'#usda 1.0\ndef Mesh "a" { \xff\x86 }']
    for suffix, data in (*(("usda", text) for text in texts), ("usdc", b"PXR-USDC" + bytes(200)), ("usdz", b"PK")):
        (tmp_path / f"a.{suffix}").write_bytes(data)
        with pytest.raises(SceneError, match=f"^a.{suffix}[: ]") as told:
            read(tmp_path / f"a.{suffix}")
        assert str(tmp_path) not in str(told.value)


def test_mesh_with_untyped_faces_is_omitted(tmp_path):
    text = '#usda 1.0\ndef Mesh "m" {{ point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n{}\n{}\n}}\n'
    counts, corners = "int[] faceVertexCounts = [3]", "int[] faceVertexIndices = [0, 1, 2]"
    for odd in ((counts.replace("int", "inp"), corners), (counts, corners.replace("int[]", "inp[]"))):
        (tmp_path / "a.usda").write_text(text.format(*odd))
        with pytest.raises(SceneError, match="has no surface"):
            read(tmp_path / "a.usda")


def test_render_settings_camera_and_near_clipping(tmp_path):
    made = stage(tmp_path / "a.usda", "Y", 0.01)
    for name in ("one", "other"):
        UsdGeom.Camera.Define(made, f"/{name}").CreateClippingRangeAttr(Gf.Vec2f(50, 1000))
    UsdGeom.Camera(made.GetPrimAtPath("/other")).CreateExposureAttr(2.0)
    cube(made, "/m")
    settings = UsdRender.Settings.Define(made, "/Render/settings")
    settings.CreateCameraRel().SetTargets(["/other"])
    made.SetMetadata("renderSettingsPrimPath", "/Render/settings")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert [c.name for c in found.cameras] == ["other", "one"]
    assert found.cameras[0].view.near == pytest.approx(0.5)
    assert any("exposure of cameras is left out" in w and w.endswith("(1): other.") for w in found.warnings)


def test_default_level_of_detail_is_used(tmp_path):
    made = stage(tmp_path / "a.usda")
    top = UsdGeom.Xform.Define(made, "/tree").GetPrim()
    top.ApplyAPI("LODRootAPI")
    top.CreateAttribute("lod:default:index", TYPES.Int).Set(1)
    for name in ("fine", "middle", "coarse"):
        cube(made, f"/tree/{name}")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert [i.name for i in found.instances] == ["middle"]
    assert any("Only the default level of detail is drawn" in w for w in found.warnings)


def test_per_instance_primvars_cause_a_warning(tmp_path):
    made = stage(tmp_path / "a.usda")
    many = UsdGeom.PointInstancer.Define(made, "/many")
    cube(made, "/many/box")
    many.CreatePrototypesRel().SetTargets(["/many/box"])
    many.CreateProtoIndicesAttr([0, 0])
    many.CreatePositionsAttr([Gf.Vec3f(0), Gf.Vec3f(3, 0, 0)])
    colors = UsdGeom.PrimvarsAPI(many).CreatePrimvar("displayColor", TYPES.Color3fArray, "varying")
    colors.Set([Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0)])
    made.GetRootLayer().Save()
    assert any("Primvars of point instancers (displayColor) are left out" in w for w in read(tmp_path / "a.usda").warnings)


def test_preview_materials_and_unknown_shaders(tmp_path):
    made = stage(tmp_path / "a.usda")
    red, _ = material(made, "/red", diffuseColor=(TYPES.Color3f, Gf.Vec3f(1, 0, 0)))
    UsdShade.MaterialBindingAPI.Apply(cube(made, "/m").GetPrim()).Bind(red, materialPurpose="preview")
    made.DefinePrim("/lamp", "PxrRectLight")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert found.materials[found.meshes[0].material].base_color == (1, 0, 0)
    assert any("Prims of the unknown type PxrRectLight are left out" in w for w in found.warnings)


def test_render_visibility_and_physics(tmp_path):
    made = stage(tmp_path / "a.usda")
    cube(made, "/shown")
    hidden = cube(made, "/hidden")
    hidden.CreatePurposeAttr("render")
    UsdGeom.VisibilityAPI.Apply(hidden.GetPrim()).CreateRenderVisibilityAttr("invisible")
    UsdPhysics.Scene.Define(made, "/physics")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert [instance.name for instance in found.instances] == ["shown"]
    assert any("Physics is not simulated: objects stay where the file places them" in w for w in found.warnings)
