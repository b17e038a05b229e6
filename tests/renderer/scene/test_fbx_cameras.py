"""Tests of FBX cameras, in text files as other programs write them."""

import math

import numpy as np
import pytest

from renderer.scene.animation import Moment
from tests.renderer.scene.fbx_text import camera, fbx, light, node, stack


def test_perspective_camera_comes_first(scene):
    objects = node(50, "a plan", "Camera") + node(51, "view", "Camera") + camera(60, CameraProjectionType=1) + camera(61, Far=9.0)
    description = scene("a.fbx", fbx(objects, [(60, 50), (50, 0), (61, 51), (51, 0)]))
    assert [(c.name, c.view.projection) for c in description.cameras] == [("view", "perspective"), ("a plan", "orthographic")]


def test_film_offset_becomes_lens_shift(scene):
    """A film offset, given in inches for a film of 36 x 24 mm, becomes a lens shift."""
    film = {"FilmWidth": 36 / 25.4, "FilmHeight": 24 / 25.4, "AspectWidth": 360.0, "AspectHeight": 240.0, "AspectRatioMode": 2}
    lens = {"ApertureMode": 3, "FocalLength": 50.0, "FilmOffsetX": 0.3 * 24 / 25.4, "FilmOffsetY": -0.1 * 24 / 25.4}
    objects = node(51, "view", "Camera") + camera(61, **film, **lens)
    view = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)])).cameras[0].view
    assert view.fov == pytest.approx(math.degrees(2 * math.atan(12 / 50)))
    assert (view.shift_x, view.shift_y) == pytest.approx((0.3, -0.1))


def test_near_plane_in_file_units(scene):
    """Geometry before the near plane, in the file's unit, is clipped; a file without a near plane clips nothing."""
    objects = node(51, "a", "Camera") + camera(61, NearPlane=40.0) + node(52, "b", "Camera") + camera(62, Far=9.0)
    views = [c.view for c in scene("a.fbx", fbx(objects, [(61, 51), (51, 0), (62, 52), (52, 0)], unit=2.54)).cameras]
    assert [view.near for view in views] == pytest.approx([40 * 0.0254, 0])


@pytest.mark.parametrize("unit", [1.0, 2.54, 100.0])
def test_orthographic_height_in_file_units(scene, unit):
    """An orthographic view is thirty units high for a zoom of 1, as Autodesk defines. unit: the file's unit in centimetres."""
    objects = node(51, "plan", "Camera") + camera(61, CameraProjectionType=1, OrthoZoom=2.0)
    view = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)], unit=unit)).cameras[0].view
    assert view.height == pytest.approx(60 * unit / 100)


def test_depth_of_field_causes_a_warning(scene):
    for said in (True, False):
        objects = node(51, "view", "Camera") + camera(61, UseDepthOfField=said, FocusDistance=120.0)
        warnings = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)])).warnings
        assert any("1 cameras with depth of field" in w for w in warnings) == said


def direction(view):
    found = np.subtract(view.target, view.eye)
    return found / np.linalg.norm(found)


@pytest.mark.parametrize("z_up", [False, True])
def test_targeted_camera_is_upright(scene, z_up):
    """A camera with a target faces it and is upright, whatever its own rotation."""
    objects = node(51, "view", "Camera", Lcl_Translation=(100.0, 200.0, 300.0), Lcl_Rotation=(0.0, 37.0, 0.0))
    objects += camera(61, Far=9.0) + node(71, "aim", "Null", Lcl_Translation=(-100.0, 50.0, 0.0))
    links = [(61, 51), (51, 0), (71, 0), (71, 51, "LookAtProperty")]
    view = scene("a.fbx", fbx(objects, links, z_up=z_up)).cameras[0].view
    towards = np.array((-2.0, -1.5, -3.0))
    towards = towards[[0, 2, 1]] * (1, 1, -1) if z_up else towards
    np.testing.assert_allclose(direction(view), towards / np.linalg.norm(towards), atol=1e-6)
    side = np.cross(direction(view), view.up)
    assert side[1] == pytest.approx(0, abs=1e-9) and view.up[1] > 0


def test_targeted_camera_keeps_its_roll(scene):
    objects = node(51, "view", "Camera", Lcl_Rotation=(30.0, 0.0, 0.0)) + camera(61, Far=9.0)
    objects += node(71, "aim", "Null", Lcl_Translation=(100.0, 0.0, 0.0))
    view = scene("a.fbx", fbx(objects, [(61, 51), (51, 0), (71, 0), (71, 51, "LookAtProperty")])).cameras[0].view
    np.testing.assert_allclose(view.up, (0, math.cos(math.radians(30)), math.sin(math.radians(30))), atol=1e-6)


def test_camera_follows_a_moving_target(scene):
    animation, links = stack(80, "take", 500.0)
    objects = node(51, "view", "Camera", Lcl_Translation=(0.0, 0.0, 500.0)) + camera(61, Far=9.0) + animation
    shot = fbx(objects, [(61, 51), (51, 0), (20, 51, "LookAtProperty"), *links])
    first, last = (scene("a.fbx", shot, moment=Moment(frame, 24)).cameras[0].view for frame in (0, 24))
    np.testing.assert_allclose(direction(first), (0, 0, -1), atol=1e-6)
    np.testing.assert_allclose(direction(last), (0.5**0.5, 0, -(0.5**0.5)), atol=1e-6)


def test_spots_point_at_their_target(scene):
    objects = node(51, "spot", "Light", Lcl_Translation=(0.0, 100.0, 0.0)) + light(61, LightType=2, Intensity=100.0)
    objects += node(71, "aim", "Null", Lcl_Translation=(100.0, 0.0, 0.0))
    links = [(61, 51), (51, 0), (71, 0), (71, 51, "LookAtProperty")]
    found = scene("a.fbx", fbx(objects, links)).lights[0]
    np.testing.assert_allclose(found.direction, (0.5**0.5, -(0.5**0.5), 0), atol=1e-6)
