"""FBX's cameras, of files in text as other programs write them."""

import math

import pytest

from tests.renderer.scene.fbx_text import camera, fbx, node


def test_a_camera_that_sees_in_perspective_comes_first(scene):
    objects = node(50, "a plan", "Camera") + node(51, "view", "Camera") + camera(60, CameraProjectionType=1) + camera(61, Far=9.0)
    description = scene("a.fbx", fbx(objects, [(60, 50), (50, 0), (61, 51), (51, 0)]))
    assert [(c.name, c.view.projection) for c in description.cameras] == [("view", "perspective"), ("a plan", "orthographic")]


def test_a_film_that_is_offset_is_a_shifted_lens(scene):
    """By inches, of a film of 36 x 24 mm."""
    film = {"FilmWidth": 36 / 25.4, "FilmHeight": 24 / 25.4, "AspectWidth": 360.0, "AspectHeight": 240.0, "AspectRatioMode": 2}
    lens = {"ApertureMode": 3, "FocalLength": 50.0, "FilmOffsetX": 0.3 * 24 / 25.4, "FilmOffsetY": -0.1 * 24 / 25.4}
    objects = node(51, "view", "Camera") + camera(61, **film, **lens)
    view = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)])).cameras[0].view
    assert view.fov == pytest.approx(math.degrees(2 * math.atan(12 / 50)))
    assert (view.shift_x, view.shift_y) == pytest.approx((0.3, -0.1))


def test_what_stands_before_a_cameras_near_plane_is_cut_away(scene):
    """In the file's unit; a file that does not say cuts nothing."""
    objects = node(51, "a", "Camera") + camera(61, NearPlane=40.0) + node(52, "b", "Camera") + camera(62, Far=9.0)
    views = [c.view for c in scene("a.fbx", fbx(objects, [(61, 51), (51, 0), (62, 52), (52, 0)], unit=2.54)).cameras]
    assert [view.near for view in views] == pytest.approx([40 * 0.0254, 0])


@pytest.mark.parametrize("unit", [1.0, 2.54, 100.0])
def test_an_orthographic_picture_is_in_units_of_the_file(scene, unit):
    """Thirty units high for a zoom of 1, as Autodesk has it; unit: in centimetres."""
    objects = node(51, "plan", "Camera") + camera(61, CameraProjectionType=1, OrthoZoom=2.0)
    view = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)], unit=unit)).cameras[0].view
    assert view.height == pytest.approx(60 * unit / 100)


def test_a_camera_with_depth_of_field_is_named(scene):
    for said in (True, False):
        objects = node(51, "view", "Camera") + camera(61, UseDepthOfField=said, FocusDistance=120.0)
        warnings = scene("a.fbx", fbx(objects, [(61, 51), (51, 0)])).warnings
        assert any("1 cameras with depth of field" in w for w in warnings) == said
