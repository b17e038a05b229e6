"""Tests of USD: lights as in the UsdLux schema, and the rotation of the sky."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from renderer.image import encode
from renderer.scene.compile import compile_scene
from renderer.scene.object_ids import number_objects
from tests.renderer.scene.usd_files import TYPES, bind, cube, material, mesh, read, stage, world


@pytest.fixture
def lit(tmp_path):
    """Returns a function `lit(kind, up, unit, **inputs)` that reads a scene of a cube and a light with these inputs."""

    def make(kind, up="Y", unit=1.0, place=None, **inputs):
        made = stage(tmp_path / "a.usda", up, unit)
        cube(made, "/m")
        light = getattr(UsdLux, kind).Define(made, "/light")
        shaping = UsdLux.ShapingAPI.Apply(light.GetPrim()) if any("cone" in name for name in inputs) else None
        for name, value in inputs.items():
            prim = (shaping or light).GetPrim()
            (prim.GetAttribute(f"inputs:{name.replace('__', ':')}") or prim.CreateAttribute(name, Sdf.ValueTypeNames.Bool)).Set(
                value
            )
        if place is not None:
            light.AddTransformOp().Set(place)
        made.GetRootLayer().Save()
        return read(tmp_path / "a.usda")

    return make


def emissive_material(found):
    """Returns the material of the emissive mesh or sphere."""
    return next(m for m in found.materials if max(m.emission) > 0)


def area(found, number=1):
    a, b, c = np.moveaxis(world(found, number), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_intensity_exposure_color_and_temperature(lit):
    color = np.array((1, 0.5, 0.25))
    options = {"intensity": 3.0, "exposure": 2.0, "color": Gf.Vec3f(*color), "enableColorTemperature": True}
    found = lit("RectLight", colorTemperature=3200.0, **options)
    expected = 3 * 2**2 * color * UsdLux.BlackbodyTemperatureAsRgb(3200.0)
    np.testing.assert_allclose(emissive_material(found).emission, expected, rtol=1e-5)
    assert not found.spectra
    warm = lit("SphereLight", colorTemperature=3200.0, enableColorTemperature=True, intensity=7.0)
    emission = np.array(emissive_material(warm).emission)
    np.testing.assert_allclose(warm.spectra[0].color, emission / emission.max(), rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "inputs", "size"),
    [
        ("RectLight", {"width": 3.0, "height": 2.0}, 3 * 2 * 8),
        ("DiskLight", {"radius": 1.5}, np.pi * 1.5**2 * 8),
        ("CylinderLight", {"radius": 0.5, "length": 4.0}, 2 * np.pi * 0.5 * 4 * 2 * np.sqrt(4 * 3)),
        ("SphereLight", {"radius": 0.5}, 4 * np.pi * 0.25 * 24 ** (2 / 3)),
    ],
)
def test_normalized_light_power_is_independent_of_size(lit, kind, inputs, size):
    place = Gf.Matrix4d().SetScale(Gf.Vec3d(2, 4, 3))
    found = lit(kind, "Z", 0.01, place, normalize=True, intensity=10.0, **inputs)
    assert emissive_material(found).emission[0] == pytest.approx(10 / size)
    if kind in ("RectLight", "DiskLight"):
        assert area(found) == pytest.approx(size * 1e-4, rel=2e-4)


def test_flat_lights_emit_along_minus_z(lit):
    for kind in ("RectLight", "DiskLight"):
        a, b, c = world(lit(kind), 1)[0]
        assert np.cross(b - a, c - a)[2] < 0
    found = lit("RectLight")
    mesh = found.meshes[found.instances[1].mesh]
    # An image's first texel is at +X, +Y: the upper left, seen from the lit side.
    first = mesh.positions[np.argmin(mesh.uvs.sum(axis=1))]
    np.testing.assert_allclose(first, (0.5, 0.5, 0))


def test_distant_light_angle(lit):
    found = lit("DistantLight", place=Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), -90)), angle=2.0, intensity=1000.0)
    (light,) = found.lights
    assert light.intensity[0] == pytest.approx(1000 * np.pi * np.sin(np.radians(1)) ** 2)
    np.testing.assert_allclose(light.direction, (0, -1, 0), atol=1e-6)
    assert light.angle == 2
    assert lit("DistantLight", angle=2.0, intensity=7.0, normalize=True).lights[0].intensity[0] == pytest.approx(7)
    assert lit("DistantLight", angle=0.0, intensity=7.0).lights[0].intensity[0] == pytest.approx(7)


def test_sphere_light_with_cone_becomes_a_spot(lit):
    options = {"shaping__cone__angle": 30.0, "shaping__cone__softness": 0.4}
    found = lit("SphereLight", "Y", 0.1, radius=2.0, intensity=5.0, **options)
    (light,) = found.lights
    assert (light.kind, light.outer_cone, light.falloff) == ("spot", 30, "smooth angle")
    assert light.inner_cone == pytest.approx(18)
    assert light.radius == pytest.approx(0.2)
    assert light.intensity[0] == pytest.approx(5 * np.pi * 0.2**2)


def test_lights_are_visible_by_default(lit):
    for kind in ("SphereLight", "RectLight", "DiskLight"):
        shown = lit(kind).materials[-1]
        assert not shown.lamp
        assert not shown.unseen
    for value in (False, True):
        light = lit("RectLight", visibleInPrimaryRay=value).materials[-1]
        assert (light.lamp, light.unseen) == (not value, not value)


def test_sphere_light_and_point_treated_sphere(lit):
    found = lit("SphereLight", "Y", 0.1, radius=2.0, intensity=5.0)
    assert found.spheres[0].radius == pytest.approx(0.2)
    assert found.materials[found.spheres[0].material].emission[0] == 5
    assert not found.lights
    (point,) = lit("SphereLight", "Y", 0.1, radius=2.0, intensity=5.0, treatAsPoint=True).lights
    assert (point.kind, point.radius) == ("point", 0)
    assert point.intensity[0] == pytest.approx(5 * np.pi * 0.2**2)


@pytest.mark.parametrize(
    ("kind", "up", "turn"), [("DomeLight", "Y", 0), ("DomeLight", "Y", 90), ("DomeLight_1", "Z", 0), ("DomeLight", "Z", 0)]
)
def test_dome_light_orientation(tmp_path, kind, up, turn):
    made = stage(tmp_path / "a.usda", up)
    cube(made, "/m")
    dome = getattr(UsdLux, kind).Define(made, "/sky")
    dome.CreateTextureFileAttr(Sdf.AssetPath("./sky.exr"))
    if turn:
        UsdGeom.Xformable(dome).AddRotateYOp().Set(float(turn))
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[24, 96] = 1000  # just beyond longitude -90 degrees, above the horizon
    encode.write(tmp_path / "sky.exr", pixels)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")

    latitude = np.radians(90 - (24.5 / 64) * 180)
    longitude = np.pi - 2 * np.pi * (96.5 / 128)
    local = np.array((np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)))
    if kind == "DomeLight_1":  # its pole is the stage's up axis
        local = np.array((local[0], -local[2], local[1]))
    x, y, z = np.array(UsdGeom.Xformable(dome).ComputeLocalToWorldTransform(0).TransformDir(Gf.Vec3d(*local)))
    wanted = np.array((x, z, -y) if up == "Z" else (x, y, z))

    image = found.images[found.environment.image].pixels[..., :3].sum(axis=2)
    rows, columns = np.nonzero(image > image.max() / 2)
    theta, phi = (rows.mean() + 0.5) / image.shape[0] * np.pi, (columns.mean() + 0.5) / image.shape[1] * 2 * np.pi - np.pi
    straight = np.array((np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)))
    angle = np.radians(found.environment.rotation)  # counter-clockwise, seen from above
    turned = (
        straight[0] * np.cos(angle) + straight[2] * np.sin(angle),
        straight[1],
        straight[2] * np.cos(angle) - straight[0] * np.sin(angle),
    )
    assert np.dot(turned, wanted) > np.cos(np.radians(3))


def test_normalized_point_light_intensity(lit):
    """A normalised point light has the same intensity for any radius.

    Its watts are pi times its intensity, of which each direction gets 1/4.
    """
    for radius in (0.0, 0.1, 2.0):
        (point,) = lit("SphereLight", radius=radius, intensity=8.0, normalize=True, treatAsPoint=True).lights
        assert point.intensity[0] == pytest.approx(2.0)


def test_blender_lights_round_trip(lit, tmp_path):
    """Blender's lights have the values that Blender reads back.

    Its exporter enables a colour temperature without one, and writes 1/4 of a sun's strength and half its angle.
    """
    (plain,) = lit("DistantLight", angle=1.25, intensity=0.5, normalize=True, enableColorTemperature=True).lights
    assert (plain.intensity, plain.angle) == (pytest.approx((0.5, 0.5, 0.5)), 1.25)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda"))
    layer.documentation = "Blender v4.5.15 LTS"
    layer.Save()
    (sun,) = read(tmp_path / "a.usda").lights
    assert (sun.intensity, sun.angle) == (pytest.approx((2.0, 2.0, 2.0)), 2.5)


def test_blender_lights_in_centimetres(lit, tmp_path):
    """Lights of a stage written by Blender in centimetres are as bright as in metres.

    Blender scales the whole stage, but normalises by sizes in metres.
    """
    lit("SphereLight", "Y", 0.01, radius=0.1, intensity=3.0, normalize=True)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda"))
    made = Usd.Stage.Open(layer)
    UsdGeom.Xformable(made.GetPrimAtPath("/light")).AddScaleOp().Set(Gf.Vec3f(100.0))
    layer.documentation = "Blender v4.5.15 LTS"
    layer.Save()
    found = read(tmp_path / "a.usda")
    assert found.spheres[0].radius == pytest.approx(0.1)
    assert emissive_material(found).emission[0] == pytest.approx(3.0 / (4 * np.pi * 0.1**2))


def test_parent_scale_does_not_enlarge_blender_lamps(lit, tmp_path):
    """Scales of parents do not enlarge the radius of lamps in Blender's stages, as in Cycles; in other stages they do."""
    place = Gf.Matrix4d().SetScale(3.0)
    assert lit("SphereLight", place=place, radius=0.1, intensity=3.0, normalize=True).spheres[0].radius == pytest.approx(0.3)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda"))
    layer.documentation = "Blender v4.5.15 LTS"
    layer.Save()
    found = read(tmp_path / "a.usda")
    assert found.spheres[0].radius == pytest.approx(0.1)
    assert emissive_material(found).emission[0] == pytest.approx(3.0 / (4 * np.pi * 0.1**2))


@pytest.mark.parametrize(("mode", "glow", "expected"), [
    ("materialGlowTintsLight", None, (6, 3, 1.5)), ("materialGlowTintsLight", (0.5, 1, 2), (3, 3, 3)),
    ("independent", (0.5, 1, 2), (6.5, 4, 3.5)), ("noMaterialResponse", (0.5, 1, 2), (6, 3, 1.5)),
])  # fmt: skip
@pytest.mark.parametrize("normalized", [False, True])
def test_mesh_light_emission(tmp_path, mode, glow, expected, normalized):
    made = stage(tmp_path / "a.usda", unit=0.1)
    square = mesh(made, "/m")
    square.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    if glow:
        bind(square, material(made, "/look", emissiveColor=(TYPES.Color3f, glow))[0])
    UsdLux.MeshLightAPI.Apply(square.GetPrim())
    api = UsdLux.LightAPI(square)
    api.CreateMaterialSyncModeAttr(mode)
    api.CreateIntensityAttr(24.0 if normalized else 6.0)
    api.CreateNormalizeAttr(normalized)
    api.CreateColorAttr(Gf.Vec3f(1, 0.5, 0.25))
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    np.testing.assert_allclose(found.materials[found.meshes[0].material].emission, expected, rtol=1e-5)


LEFT_OUT = {  # light inputs without support, and their warnings
    "inputs:shaping:ies:file": (Sdf.AssetPath("a.ies"), "IES profiles that are not among the files"),
    "inputs:shaping:focus": (8.0, "The focus of lights"),
    "inputs:shadow:enable": (False, "Lights without shadows"),
    "inputs:shadow:color": (Gf.Vec3f(1, 0, 0), "Shadow colour, distance and falloff of lights are ignored"),
    "inputs:shadow:distance": (3.0, "Shadow colour, distance and falloff of lights are ignored"),
    "inputs:specular": (0.0, "Diffuse and specular multipliers of lights are ignored"),
    "inputs:intensity": (5.0, None),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_unsupported_light_features_are_named(tmp_path, name):
    made = stage(tmp_path / "a.usda")
    value, expected = LEFT_OUT[name]
    prim = UsdLux.SphereLight.Define(made, "/light").GetPrim()
    for schema in (UsdLux.ShapingAPI, UsdLux.ShadowAPI):
        schema.Apply(prim)
    prim.GetAttribute(name).Set(value)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda").warnings
    assert [w for w in found if "/light" in w and expected and expected in w] if expected else not found


def test_collection_light_link_limits_lights(tmp_path):
    """Lights illuminate the prims of their collection lightLink; those that illuminate the same prims share a link set."""
    made = stage(tmp_path / "a.usda")
    for name in ("/group/a", "/group/b", "/c"):
        cube(made, name)
    lights = [UsdLux.LightAPI(UsdLux.SphereLight.Define(made, f"/light{k}").GetPrim()) for k in range(4)]
    lights[0].GetLightLinkCollectionAPI().CreateExcludesRel().AddTarget("/group/a")
    lights[1].GetLightLinkCollectionAPI().CreateIncludeRootAttr(False)
    lights[1].GetLightLinkCollectionAPI().CreateIncludesRel().AddTarget("/group")
    lights[2].GetLightLinkCollectionAPI().CreateIncludeRootAttr(False)
    for path in ("/group/b", "/c"):
        lights[2].GetLightLinkCollectionAPI().CreateIncludesRel().AddTarget(path)
    lights[3].GetShadowLinkCollectionAPI().CreateExcludesRel().AddTarget("/c")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    links = [found.materials[each.material].light_link for each in found.spheres]
    assert [found.light_links[link].exclude if link else () for link in links] == [("a",), ("c",), ("a",), ()]
    assert links[0] == links[2]
    shadows = [found.materials[each.material].shadow_link for each in found.spheres]
    assert shadows == ["", "", "", links[1]]
    assert not found.warnings
    compiled = compile_scene(found)
    masks = dict(zip(number_objects(found).names, compiled.object_links.tolist(), strict=True))
    assert [bin(masks[name]) for name in ("a", "b", "c")] == ["0b101", "0b111", "0b11"]


def test_renderer_specific_lights_are_named(tmp_path):
    made = stage(tmp_path / "a.usda")
    cube(made, "/m")
    UsdLux.PluginLight.Define(made, "/light")
    made.GetRootLayer().Save()
    assert any("PluginLight" in w and "/light" in w for w in read(tmp_path / "a.usda").warnings)
