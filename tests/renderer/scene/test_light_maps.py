"""Tests of lights with profiles or projected images, in each format: the intensity that a light sends to a point of the scene."""

import math

import numpy as np
import pytest
from pxr import Sdf, UsdGeom, UsdLux

from renderer.errors import SceneError
from renderer.image import encode
from renderer.scene.animation import Moment
from renderer.scene.emission_maps import emission_frames, maps_of
from tests.renderer.scene import usd_files
from tests.renderer.scene.builders import Gltf
from tests.renderer.scene.ies_files import ies, looked_up
from tests.renderer.scene.pbrt_files import world

QUAD = "shapes:\n  - {type: quad}\n"
PLANES = np.arange(0, 361, 15.0)
ANGLES = np.arange(0, 181, 5.0)


def web(theta, phi):
    """Returns the intensity of a light profile that is linear in both angles (degrees)."""
    return 100 + theta + np.interp(phi % 360, (0, 90, 270, 360), (0, 60, 20, 0))


PROFILE = ies(ANGLES, PLANES, web)


def sent(light, point):
    """Returns a light's radiant intensity (3,) towards a scene point, ignoring spot cones."""
    frame = emission_frames([light], maps_of([light]))[0].astype(float)
    f = np.array(light.direction) / np.linalg.norm(light.direction)
    r = frame[:3]
    w = np.subtract(point, light.position)
    local = np.array([w @ r, w @ np.cross(r, f), w @ f])
    return looked_up(light.emission, local[None] / np.linalg.norm(w))[0] * np.array(light.intensity)


def angles_of(w, axis, right):
    """Returns two angles of the direction w in degrees: to the axis, and the azimuth from `right` towards `right` x `axis`."""
    w, axis, right = (np.array(v, float) / np.linalg.norm(v) for v in (w, axis, right))
    return math.degrees(math.acos(w @ axis)), math.degrees(math.atan2(w @ np.cross(right, axis), w @ right))


def four_colors(side=64):
    """Returns an image with red at the upper left, green at the upper right, blue and white below them."""
    corner = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], np.float32)
    return corner.repeat(side, axis=0).repeat(side, axis=1)


PICTURE = encode.encode(four_colors(), "exr")


def test_scene_file_profiles_and_images(scene):
    found = scene(
        "s.yaml",
        """
lights:
  - {type: point, position: [1, 2, 3], profile: lamp.ies, intensity: 683}
  - {type: spot, position: [0, 0, 5], target: [0, 0, 0], profile: lamp.ies, color: [683, 0, 0], up: [1, 0, 0]}
  - {type: spot, position: [0, 0, 5], direction: [0, 0, -1], outer_cone: 45, picture: slide.exr, intensity: 2}
  - {type: projector, position: [0, 0, 5], direction: [0, 0, -1], fov: 90, picture: slide.exr, intensity: 2}
  - {type: point, position: [0, 0, 0], picture: slide.exr}
"""
        + QUAD,
        {"lamp.ies": PROFILE, "slide.exr": PICTURE},
    )
    lamp, spot, gobo, projector, lantern = found.lights
    for w in ((0.3, -1, 0.2), (-1, 0.1, 2), (0.5, -0.2, -1)):  # axis down, C0 along X, C90 along -Z
        np.testing.assert_allclose(sent(lamp, np.add(lamp.position, w)), web(*angles_of(w, (0, -1, 0), (1, 0, 0))), rtol=1e-3)
        expected = web(*angles_of(w, (0, 0, -1), np.cross((0, 0, -1), (1, 0, 0))))
        np.testing.assert_allclose(sent(spot, np.add(spot.position, w)), [expected, 0, 0], rtol=1e-3)
    assert lamp.emission is spot.emission
    for light in (gobo, projector):
        for x, y, color in ((-0.5, 0.5, (1, 0, 0)), (0.5, 0.5, (0, 1, 0)), (-0.5, -0.5, (0, 0, 1)), (0.5, -0.5, (1, 1, 1))):
            gain = 1.0 if light is gobo else (1 + x * x + y * y) ** 1.5
            np.testing.assert_allclose(sent(light, (x, y, 4)), 2 * gain * np.array(color), rtol=1e-4, atol=1e-6)
    assert (gobo.kind, projector.kind) == ("spot", "point")
    np.testing.assert_allclose(sent(lantern, (-0.5, 0.5, -1)), (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(sent(lantern, (0.5, 0.5, 1)), (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(sent(lantern, (0.5, -0.5, -1)), (1, 1, 1), atol=1e-6)
    assert found.warnings == []


def test_rotating_light_keeps_its_profile(scene):
    text = "lights: [{type: point, position: [0, 2, 0], profile: a.ies, direction: {keys: [[0, [0, -1, 0]], [1, [1, 0, 0]]]}}]\n"
    for seconds, direction in ((0, (0, -1, 0)), (1, (1, 0, 0))):
        found = scene("s.yaml", text + QUAD, {"a.ies": PROFILE}, moment=Moment(frame=24.0 * seconds))
        np.testing.assert_allclose(found.lights[0].direction, direction, atol=1e-6)


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ("{type: point, position: [0, 1, 0], profile: b.ies}", r"lights\[0\].profile: b.ies is not among the files; add it"),
        ("{type: point, position: [0, 1, 0], profile: bad.ies}", "is not an IES profile: it has no line TILT="),
        ("{type: point, position: [0, 1, 0], picture: bad.ies}", r"lights\[0\].picture: could not be read"),
        (
            "{type: point, position: [0, 1, 0], up: [0, 1, 0]}",
            r"lights\[0\]\.up: has no meaning for a point light without a profile or picture",
        ),
        (
            "{type: directional, direction: [0, -1, 0], profile: a.ies}",
            r"lights\[0\]\.profile: has no meaning for a directional light",
        ),
        ("{type: projector, position: [0, 1, 0], direction: [0, -1, 0]}", "a projector needs a picture"),
        (
            "{type: point, position: [0, 1, 0], profile: a.ies, picture: slide.exr}",
            "cannot be combined with a profile; leave one of them out",
        ),
        ("{type: spot, position: [0, 1, 0], direction: [0, -1, 0], outer_cone: 90, picture: slide.exr}", "narrower"),
        (
            "{type: point, position: [0, 1, 0], direction: [0, -1, 0], picture: slide.exr}",
            "is parallel to the light's direction; give the up direction of its picture",
        ),
    ],
)
def test_scene_file_light_errors(scene, light, said):
    with pytest.raises(SceneError, match=said):
        scene("s.yaml", f"lights: [{light}]\n" + QUAD, {"a.ies": PROFILE, "bad.ies": b"no", "slide.exr": PICTURE})


def test_gltf_light_profiles(scene):
    """Profiles of EXT_lights_ies have their zero angle at -Z, and horizontal angles from X to Y."""
    g = Gltf()
    g.mesh()
    g.root["extensions"] = {"EXT_lights_ies": {"lights": [{"uri": "lamp%20a.ies"}]}}
    g.root["extensionsUsed"] = ["EXT_lights_ies"]
    shaped = {"EXT_lights_ies": {"light": 0, "multiplier": 2, "color": [1, 0.5, 0]}}
    g.node(name="lamp", translation=[1, 2, 3], scale=[2, 2, 2], extensions=shaped)
    found = scene("a.glb", g.glb(), {"lamp a.ies": PROFILE})
    (light,) = found.lights
    assert light.name == "lamp" and found.warnings == []
    for w in ((0.3, 0.2, -1), (-1, 0.5, 0.3)):
        expected = web(*angles_of(w, (0, 0, -1), (1, 0, 0))) * np.array([2, 1, 0]) / 683
        np.testing.assert_allclose(sent(light, np.add((1, 2, 3), w)), expected, rtol=1e-3)


def test_gltf_missing_profile_causes_a_warning(scene):
    g = Gltf()
    g.mesh()
    g.root["extensions"] = {"EXT_lights_ies": {"lights": [{"uri": "lamp.ies"}]}}
    g.node(name="lamp", extensions={"EXT_lights_ies": {"light": 0}})
    found = scene("a.glb", g.glb())
    assert not found.lights and "lamp.ies is not among the files" in " ".join(found.warnings)


@pytest.mark.parametrize("kind", ["SphereLight", "DiskLight", "RectLight"])
def test_usd_light_profiles(tmp_path, kind):
    """USD profiles scale radiance by direction as in hdEmbree: their axis is -Z, C0 is towards -X and C90 towards -Y."""
    (tmp_path / "lamp.ies").write_bytes(PROFILE)
    made = usd_files.stage(tmp_path / "a.usda", "Y", 1.0)
    usd_files.cube(made, "/m")
    light = getattr(UsdLux, kind).Define(made, "/light")
    UsdGeom.Xformable(light).AddTranslateOp().Set((1.0, 2.0, 3.0))
    UsdLux.ShapingAPI.Apply(light.GetPrim()).CreateShapingIesFileAttr(Sdf.AssetPath("./lamp.ies"))
    light.CreateIntensityAttr(4.0)
    sizes = {"SphereLight": ({"radius": 0.5}, math.pi / 4), "DiskLight": ({"radius": 0.5}, math.pi / 4)}
    inputs, area = sizes.get(kind, ({"width": 2.0, "height": 0.5}, 1.0))
    for name, value in inputs.items():
        light.GetPrim().GetAttribute(f"inputs:{name}").Set(value)
    made.GetRootLayer().Save()
    (found,) = usd_files.read(tmp_path / "a.usda").lights
    for w in ((0.3, 0.2, -1), (-1, 0.5, -0.3)):
        cosine = 1.0 if kind == "SphereLight" else -w[2] / math.hypot(*w)
        expected = 4 * area * cosine * web(*angles_of(w, (0, 0, -1), (-1, 0, 0)))
        np.testing.assert_allclose(sent(found, np.add((1, 2, 3), w)), expected, rtol=2e-3)


def test_usd_profile_scale_and_normalization(tmp_path):
    (tmp_path / "lamp.ies").write_bytes(ies(ANGLES, [0.0], lambda theta, phi: 1000 * np.cos(np.radians(theta / 2)) ** 2))
    made = usd_files.stage(tmp_path / "a.usda", "Y", 1.0)
    usd_files.cube(made, "/m")
    for name, scale, even in (("/a", 0.5, False), ("/b", 0.0, True)):
        light = UsdLux.SphereLight.Define(made, name)
        light.CreateTreatAsPointAttr(True)
        light.CreateIntensityAttr(1 / (math.pi * 0.25))
        shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
        shaping.CreateShapingIesFileAttr(Sdf.AssetPath("lamp.ies"))
        shaping.CreateShapingIesAngleScaleAttr(scale)
        shaping.CreateShapingIesNormalizeAttr(even)
    made.GetRootLayer().Save()
    stretched, even = usd_files.read(tmp_path / "a.usda").lights
    for degrees in (10, 60, 120, 170):
        w = math.sin(math.radians(degrees)), 0, -math.cos(math.radians(degrees))
        own = max((degrees - 180) / 1.5 + 180, 0)  # angles are scaled about 180 degrees
        np.testing.assert_allclose(sent(stretched, w), 1000 * math.cos(math.radians(own / 2)) ** 2, rtol=5e-3, atol=1)
        np.testing.assert_allclose(
            sent(even, w), 2 * math.cos(math.radians(degrees / 2)) ** 2, rtol=5e-3
        )  # normalised to a mean of 1


def _near(point):
    x, y, z = point
    return f'AttributeBegin Translate {x} {y} {z} Shape "sphere" "float radius" 0.01 AttributeEnd\n'


def _positions(found):
    """Returns the positions of a scene's small balls."""
    return [ball.center for ball in found.spheres]


POINTS = [(0.3, 0.2, 1), (-0.3, 0.2, 1), (0.3, -0.2, 1), (-0.3, -0.2, 1)]
COLORS = [(0, 1, 0), (1, 0, 0), (1, 1, 1), (0, 0, 1)]  # pbrt's x is to the right for a viewer facing z


def test_pbrt_projection_light(scene):
    """Images projected by pbrt's lights are upright for a viewer facing z; the intensity does not depend on the angle."""
    lamp = 'LightSource "projection" "string filename" "slide.exr" "float fov" 60 "float scale" 5\n'
    found = scene("s.pbrt", world(lamp + "".join(map(_near, POINTS))), {"slide.exr": PICTURE})
    (light,) = found.lights
    for place, color in zip(_positions(found), COLORS, strict=True):
        np.testing.assert_allclose(sent(light, place), 5 * np.array(color), rtol=1e-4, atol=1e-6)
    powered = scene("s.pbrt", world(lamp.replace("scale", "power") + _near(POINTS[0])), {"slide.exr": PICTURE})
    x, y = np.meshgrid(*[(np.arange(128) + 0.5) / 64 - 1] * 2)
    weight = (1 + (x * x + y * y) / 3) ** -1.5
    whole = 4 / 3 * (four_colors() @ (0.2126, 0.7152, 0.0722) * weight).mean()
    np.testing.assert_allclose(sent(powered.lights[0], _positions(powered)[0]), (0, 5 / whole, 0), rtol=1e-3, atol=1e-6)


def test_pbrt_goniometric_light(scene):
    """Goniometric images of pbrt's lights are equal-area squares centred on y, multiplied by the light's spectrum."""
    from renderer.scene.readers.pbrt.equal_area import to_square

    size = 64
    picture = np.random.default_rng(2).uniform(0.5, 1, (8, 8)).repeat(8, axis=0).repeat(8, axis=1)
    pixels = np.repeat(picture[..., None], 3, axis=2).astype(np.float32)
    points = [(1, 2, 3), (-1, 0.5, 0.3), (0.3, -1, 0.2), (0.1, 0.2, -1), (-2, -1, -1)]
    lamp = 'LightSource "goniometric" "string filename" "web.exr" "rgb I" [1 1 1] "float scale" 3\n'
    found = scene("s.pbrt", world(lamp + "".join(map(_near, points))), {"web.exr": encode.encode(pixels, "exr")})
    for place, (x, y, z) in zip(_positions(found), points, strict=True):
        unit = np.array((x, z, y)) / math.hypot(x, y, z)
        u, v = to_square(unit)
        np.testing.assert_allclose(sent(found.lights[0], place), 3 * pixels[int(v * size), int(u * size)], rtol=2e-2)
    powered = scene("s.pbrt", world(lamp.replace("scale", "power") + _near(points[0])), {"web.exr": encode.encode(pixels, "exr")})
    ratio = sent(powered.lights[0], _positions(powered)[0]) / sent(found.lights[0], _positions(found)[0])
    np.testing.assert_allclose(ratio, 1 / (4 * math.pi * pixels.mean()), rtol=1e-4)


def test_mitsuba_projector(scene):
    """Images projected by Mitsuba's lights are upright for a viewer facing z, with x to the left.

    A spot light's texture is rotated by 180 degrees.
    """
    text = """<scene version="3.0.0"><emitter type="{}"><float name="{}" value="{}"/>{}
    <texture type="bitmap" name="{}"><string name="filename" value="slide.exr"/></texture></emitter>
    <shape type="sphere"/></scene>"""
    projector = text.format("projector", "fov", 60, '<float name="scale" value="2"/>', "irradiance")
    (light,) = scene("s.xml", projector, {"slide.exr": PICTURE}).lights
    for (x, y, z), color in zip(POINTS, [COLORS[1], COLORS[0], COLORS[3], COLORS[2]], strict=True):
        gain = 2 * math.pi * (1 + x * x + y * y) ** 1.5
        np.testing.assert_allclose(sent(light, (x, y, z)), gain * np.array(color), rtol=1e-4, atol=1e-6)
    spot = text.format("spot", "cutoff_angle", 30, '<rgb name="intensity" value="2 2 2"/>', "texture")
    (light,) = scene("s.xml", spot, {"slide.exr": PICTURE}).lights
    for (x, y, z), color in zip(POINTS, [COLORS[2], COLORS[3], COLORS[0], COLORS[1]], strict=True):
        np.testing.assert_allclose(sent(light, (x, y, z)), 2 * np.array(color), rtol=1e-4, atol=1e-6)
