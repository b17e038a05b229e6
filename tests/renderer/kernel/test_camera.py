"""Tests of cameras: scale, depth of field, and directions of panoramas."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.film import DEPTH, NORMAL, POSITION, mean
from renderer.jit import entry
from renderer.kernel.camera import camera_frame, camera_ray, exposure_time, moving_ray
from renderer.render import render_frame
from renderer.scene.animation.orbit import orbit
from renderer.scene.description import Material, Sphere
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import emitter, gray, icosphere, scene, square
from tests.renderer.judge import assert_mean


@entry
def _rays(camera, x, y, u, v, out):
    for i in range(len(x)):
        o, d, _ = camera_ray(camera, x[i], y[i], (u[i], v[i]))
        out[i, 0], out[i, 1], out[i, 2] = o
        out[i, 3], out[i, 4], out[i, 5] = d


def rays(view, x, y, u=0.5, v=0.5, width=64, height=48):
    """Returns the origins and directions of rays through film points (x, y), in pixels, and lens samples (u, v) in [0, 1)."""
    columns = np.broadcast_arrays(*(np.atleast_1d(np.asarray(c, np.float32)) for c in (x, y, u, v)))
    out = np.empty((columns[0].size, 6), np.float32)
    _rays(camera_frame(RenderSettings(width, height, view)), *(np.ascontiguousarray(c) for c in columns), out)
    return out[:, :3].astype(float), out[:, 3:].astype(float)


LEVEL = {"eye": (1, 2, 3), "target": (1, 2, -1)}
TILTED = {"eye": (1, 2, 3), "target": (-4, 0.5, 2), "up": (0.1, 1, 0.3)}


@pytest.mark.parametrize("projection", ["perspective", "orthographic", "panorama"])
@pytest.mark.parametrize("view", [LEVEL, TILTED])
def test_camera_centre_looks_at_the_target(projection, view):
    o, d = rays(View(**view, projection=projection), [32, 32, 33], [24, 23, 24])
    eye, target = np.array(view["eye"], float), np.array(view["target"], float)
    sight = (target - eye) / np.linalg.norm(target - eye)
    np.testing.assert_allclose(d[0], sight, atol=1e-6)
    np.testing.assert_allclose(o[0], eye, atol=1e-6)
    up, right = (o + d)[1] - (o + d)[0], (o + d)[2] - (o + d)[0]
    hint = np.array(view.get("up", (0, 1, 0)))
    across = np.cross(sight, hint)
    assert up @ hint > 0
    assert right @ across > 0.99 * np.linalg.norm(right) * np.linalg.norm(across)
    assert up @ across == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-6)


def test_a_perspective_camera_spans_its_field_of_view():
    _, d = rays(View(**LEVEL, fov=50), [32, 32, 0], [0, 48, 24])
    assert math.degrees(math.acos(d[0] @ d[1])) == pytest.approx(50, abs=1e-4)
    assert d[2, 0] / -d[2, 2] == pytest.approx(-math.tan(math.radians(25)) * 64 / 48, rel=1e-5)


def test_orthographic_camera_height():
    o, d = rays(View(**LEVEL, projection="orthographic", height=6.0), [0, 64, 0], [0, 0, 48])
    np.testing.assert_allclose(d, [(0, 0, -1)] * 3, atol=1e-7)
    np.testing.assert_allclose(o, [(1 - 4, 2 + 3, 3), (1 + 4, 2 + 3, 3), (1 - 4, 2 - 3, 3)], atol=1e-5)
    ball = scene([Material(base_color=gray(0.5))], spheres=(Sphere((0, 0, 0), 1.0),), environment=1.0)
    view = View((0, 0, 4), (0, 0, 0), projection="orthographic", height=3.0)
    depth = mean(render_frame(ball, RenderSettings(120, 120, view, max_depth=1, filter="box"), 16), 24, DEPTH)
    # The ball's disk, pi, in a picture of 3 x 3 units; with 16 samples per pixel its area is accurate to 1/400
    hit = depth > 0
    assert hit.mean() == pytest.approx(math.pi / 9, abs=0.01)
    middle = depth[58:62, 58:62]
    np.testing.assert_allclose(middle, 3.0, atol=2e-3)


def test_panorama_directions():
    x, y = np.array([32, 48, 16, 0.001, 32, 32]), np.array([24, 24, 24, 24, 0, 48])
    _, d = rays(View(**LEVEL, projection="panorama"), x, y)
    expected = [(0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 1, 0), (0, -1, 0)]
    np.testing.assert_allclose(d, expected, atol=2e-4)
    around, _ = np.meshgrid((np.arange(64) + 0.5), np.arange(1))
    _, ring = rays(View(**LEVEL, projection="panorama"), around.ravel(), 12)
    np.testing.assert_allclose(ring[:, 1], math.sin(math.radians(45)), atol=1e-6)


@pytest.mark.parametrize("integrator", ["path", "direct"])
@grid("sampler", ["sobol", "independent"], ordinary=("sobol",))
@pytest.mark.parametrize("projection", ["perspective", "lens", "orthographic", "panorama"])
def test_furnace_with_every_camera(projection, sampler, integrator):
    lens = {"projection": "perspective", "aperture": 0.05, "focus": 0.5} if projection == "lens" else {"projection": projection}
    view = View((0.1, 0.2, 0.0), (0.8, 0.1, 0.2), fov=80, height=0.5, **lens)
    wall = Material(base_color=gray(0.5), emission=gray(0.5), double_sided=True)
    furnace = scene([wall], (icosphere(1),))
    depth, expected = (100, 1.0) if integrator == "path" else (8, 0.75)
    asked = RenderSettings(24, 16, view, max_depth=depth, sampler=sampler, integrator=integrator)
    assert_mean(render_frame(furnace, asked, 128), expected, slack=1e-4)


def test_depth_of_field_blur_radius():
    """All rays of a film point meet in the focal plane; at distance z they fill a disk of radius aperture * |z / focus - 1|."""
    view = View((0, 0, 5), (0, 0, 4), fov=40, aperture=0.2, focus=2.5)
    u, v = np.random.default_rng(0).random((2, 4096))
    o, d = rays(view, 20, 30, u, v)
    assert np.abs(o[:, 2] - 5).max() < 1e-6
    radius = np.linalg.norm(o[:, :2], axis=1)
    assert radius.max() == pytest.approx(0.2, rel=0.01)
    assert (radius**2).mean() == pytest.approx(0.02, rel=0.1)  # uniform over the disk
    sharp = o + d * (2.5 / -d[:, 2])[:, None]
    np.testing.assert_allclose(sharp, np.broadcast_to(sharp[0], sharp.shape), atol=2e-6)
    far = o + d * (7.5 / -d[:, 2])[:, None]
    assert np.linalg.norm(far - far.mean(0), axis=1).max() == pytest.approx(0.2 * (7.5 / 2.5 - 1), rel=0.02)


@pytest.mark.long
def test_defocused_point_light_is_a_disk():
    """A point light at distance z images to a disk of radius aperture |z - f| / z in the focal plane f: its area and edge."""
    aperture, focus, z, size = 0.3, 2.0, 4.0, 64
    light = scene([emitter(1e4)], (square((0, 0, -z), (0.01, 0, 0), (0, 0.01, 0), 0),))
    view = View((0, 0, 0), (0, 0, -1), fov=30, aperture=aperture, focus=focus)
    picture = mean(render_frame(light, RenderSettings(size, size, view, max_depth=1, filter="box"), 4096), 24)[..., 0]
    pixel = 2 * math.tan(math.radians(15)) / size * focus  # a pixel's size in the focal plane
    expected = aperture * (z - focus) / z / pixel
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    r = np.hypot(x, y)
    assert not picture[r > expected + 1.5].any()
    assert (picture[r < expected - 1.5] > 0).mean() > 0.9
    assert (picture * r**2).sum() / picture.sum() == pytest.approx(expected**2 / 2, rel=0.05)


def test_zero_aperture_equals_a_pinhole():
    assert (rays(View(**LEVEL), 5, 7, 0.1, 0.9)[1] == rays(View(**LEVEL, focus=9.0), 5, 7, 0.7, 0.2)[1]).all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_lens_shift_equals_a_crop(projection):
    """A shifted view equals a crop of a larger one.

    The 96 x 72 pixels at (50, 12) of 256 x 192, whose middle is (128, 96), are shifted 30 to the left and 48 up.
    """
    large = View(**TILTED, fov=80, projection=projection, height=4.0, aperture=0.1, focus=3.0)
    fov = math.degrees(2 * math.atan(math.tan(math.radians(40)) * 72 / 192))
    shift = {"shift_x": (98 - 128) / 72, "shift_y": (96 - 48) / 72}
    piece = replace(large, fov=fov, height=4.0 * 72 / 192, **shift)
    x, y = np.meshgrid(np.arange(96.0), np.arange(72.0))
    whole = rays(large, x.ravel() + 50, y.ravel() + 12, 0.3, 0.6, 256, 192)
    for a, b in zip(rays(piece, x.ravel(), y.ravel(), 0.3, 0.6, 96, 72), whole, strict=True):
        np.testing.assert_allclose(a, b, atol=3e-6)
    assert piece.middle(96, 72) == pytest.approx((128 - 50, 96 - 12))
    for time, found in zip(*over_the_shutter((large, piece), 96, 72), strict=True):
        mixed = {k: (1 - time) * getattr(large, k) + time * getattr(piece, k) for k in shift}
        tall = (1 - time) * math.tan(math.radians(40)) + time * math.tan(math.radians(fov) / 2)
        height = (1 - time) * large.height + time * piece.height
        between = replace(large, fov=math.degrees(2 * math.atan(tall)), height=height, **{k: float(v) for k, v in mixed.items()})
        np.testing.assert_allclose(found, np.concatenate(rays(between, 20, 13, 0.3, 0.8, 96, 72), 1)[0], atol=3e-6)


def test_panorama_ignores_lens_shift():
    view = View(**TILTED, projection="panorama")
    for a, b in zip(rays(replace(view, shift_x=0.5, shift_y=0.2), 5, 7), rays(view, 5, 7), strict=True):
        assert (a == b).all()


def test_near_plane_clips():
    wall = square((0, 0, 2), (9, 0, 0), (0, 9, 0), 0)
    back = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    room = scene([emitter(1.0, double_sided=True), emitter(2.0)], (wall, back))
    for projection in ("perspective", "orthographic"):
        for near, seen in ((0.0, 1.0), (1.9, 1.0), (2.1, 2.0)):
            view = View((0, 0, 4), (0, 0, 0), fov=60, projection=projection, near=near)
            sums = render_frame(room, RenderSettings(16, 16, view, max_depth=1, filter="box"), 1)
            assert (mean(sums, 24) == seen).all()
            hit = mean(sums, 24, POSITION)
            depth = mean(sums, 24, DEPTH)
            if projection == "orthographic":
                np.testing.assert_allclose(depth, 2 if seen == 1 else 6, atol=1e-5)
            else:
                np.testing.assert_allclose(depth, np.linalg.norm(hit - np.array([0, 0, 4]), axis=-1), atol=1e-4)
            np.testing.assert_allclose(hit[..., 2], 2 if seen == 1 else -2, atol=1e-5)
            np.testing.assert_allclose(mean(sums, 24, NORMAL)[..., 2], 1, atol=1e-6)


@entry
def _moving_rays(camera, x, y, u, v, time, out):
    for i in range(len(time)):
        o, d, _ = moving_ray(camera, x, y, (u, v), time[i])
        out[i, 0], out[i, 1], out[i, 2] = o
        out[i, 3], out[i, 4], out[i, 5] = d


def over_the_shutter(views, width=64, height=48):
    """Returns times, ray origins and ray directions of one film point and one lens point over the open shutter."""
    time = np.linspace(0, 1, 33).astype(np.float32)
    out = np.empty((len(time), 6), np.float32)
    numbers = (np.float32(number) for number in (20, 13, 0.3, 0.8))
    _moving_rays(camera_frame(RenderSettings(width, height, views[0], views=views)), *numbers, time, out)
    return time, out


@pytest.mark.parametrize("projection", ["perspective", "orthographic", "panorama"])
def test_orbiting_camera_moves_on_a_circle(projection):
    """A camera that orbits half a turn moves on the circle between its three keys; linear interpolation would cut through it."""
    start = View(**TILTED, aperture=0.1, projection=projection)
    time, found = over_the_shutter(tuple(orbit(start, turns) for turns in (0.0, 0.25, 0.5)))
    for share, ray in zip(time, found, strict=True):
        o, d = rays(orbit(start, float(share) / 2), 20, 13, 0.3, 0.8)
        np.testing.assert_allclose(ray, np.concatenate([o[0], d[0]]), atol=2e-6)


def test_moving_zooming_camera_is_interpolated_linearly():
    first, last = View((0, 0, 5), (0, 0, 0), fov=20, aperture=0.1), View((4, 0, 5), (4, 0, 0), fov=80, aperture=0.3, focus=7)
    time, found = over_the_shutter((first, last))
    middle = float(np.tan(np.radians(10)) + np.tan(np.radians(40))) / 2
    half = View((2, 0, 5), (2, 0, 0), fov=2 * math.degrees(math.atan(middle)), aperture=0.2, focus=6)
    o, d = rays(half, 20, 13, 0.3, 0.8)
    np.testing.assert_allclose(found[np.flatnonzero(time == 0.5)[0]], np.concatenate([o[0], d[0]]), atol=2e-6)


def test_incompatible_views_are_rejected():
    flat, deep = View(**LEVEL, projection="orthographic"), View(**LEVEL)
    with pytest.raises(SettingsError, match="different projections"):
        RenderSettings(8, 8, deep, views=(deep, flat))
    with pytest.raises(SettingsError, match="needs 2 to 65"):
        RenderSettings(8, 8, deep, views=(deep,))


def test_views_round_trip_through_json():
    settings = RenderSettings(8, 8, View(**LEVEL), views=(View(**LEVEL), View(**TILTED)), shutter=0.5)
    assert RenderSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


def test_rolling_shutter_exposes_one_row_after_the_other():
    """A row's exposure begins with its share of the readout; otherwise the random number is the time, to the bit."""
    half, third = np.float32(0.5), np.float32(1 / 3)

    def time(x, y, u, **rolling):
        camera = camera_frame(RenderSettings(40, 20, View(**LEVEL), shutter=0.5, **rolling))
        return float(exposure_time.py_func(camera, np.float32(x) + half, np.float32(y) + half, u))

    assert time(39, 19, third) == float(third)
    for share in (0.75, 1.0):
        for u in (0.0, 0.5, 0.999):
            begin = (1 - share) * u
            for x, y in ((0, 0), (39, 0), (7, 11), (0, 19), (39, 19)):
                down, across = share * (y + 0.5) / 20, share * (x + 0.5) / 40
                expected = {"top": down, "bottom": share - down, "left": across, "right": share - across}
                for edge, after in expected.items():
                    found = time(x, y, np.float32(u), rolling_shutter=share, rolling_shutter_from=edge)
                    assert found == pytest.approx(begin + after, abs=1e-6)
                    assert 0 <= found < 1
