"""Tests of lens distortion: rays against OpenCV's published formulas, invalid coefficients, and cameras without distortion."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.jit import entry
from renderer.kernel.camera import axes_of, camera_frame, distortion_row, moving_ray
from renderer.kernel.distortion import undistort_points
from renderer.lens_distortion import LensDistortion
from renderer.settings import RenderSettings, View
from renderer.vectors import border_angles, projected

WIDTH, HEIGHT = 640, 480
VIEW = View((1.0, 2.0, 3.0), (-4.0, 0.5, 2.0), (0.1, 1.0, 0.3), 62.0, shift_x=0.03, shift_y=-0.02)
LENSES = {
    "barrel": LensDistortion("brown", (-0.21, 0.06, 0.0012, -0.0021, 0.011)),
    "rational": LensDistortion("brown", (0.3, -0.1, -0.002, 0.001, 0.02, 0.35, -0.05, 0.01)),
    "fisheye": LensDistortion("fisheye", (-0.012, 0.004, -0.002, 0.0003)),
    "wide": LensDistortion("fisheye", (0.02, -0.003)),
}


@entry
def _rays(camera, x, y, out):
    half = np.float32(0.5)
    for i in range(len(x)):
        o, d, start = moving_ray(camera, x[i], y[i], (half, half), half)
        out[i, 0], out[i, 1], out[i, 2] = o
        out[i, 3], out[i, 4], out[i, 5] = d
        out[i, 6] = start


def rays(view: View, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    out = np.empty((len(x), 7), np.float32)
    _rays(camera_frame(RenderSettings(WIDTH, HEIGHT, view)), x.astype(np.float32), y.astype(np.float32), out)
    return out.astype(np.float64)


def opencv(lens: LensDistortion, points: np.ndarray, focal: float, middle: tuple[float, float]) -> np.ndarray:
    """Returns the pixels of points (N, 3) of the camera's space, y down, as OpenCV's documentation defines them."""
    x, y, z = points.T
    a, b = x / z, y / z
    r = np.hypot(a, b)
    if lens.model == "fisheye":
        k1, k2, k3, k4 = (*lens.coefficients, 0.0, 0.0)[:4]
        t = np.arctan2(np.hypot(x, y), z)
        seen = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8) / np.hypot(x, y)
        u, v = seen * x, seen * y
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.coefficients, *(0.0,) * 8)[:8]
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        u = a * radial + 2 * p1 * a * b + p2 * (r**2 + 2 * a**2)
        v = b * radial + p1 * (r**2 + 2 * b**2) + 2 * p2 * a * b
    return np.stack([focal * u + middle[0], focal * v + middle[1]], -1)


def named_view(name: str) -> View:
    return replace(VIEW, distortion=LENSES[name], fov=116.0 if name == "wide" else VIEW.fov)


def focal_of(view: View) -> float:
    return float(HEIGHT / 2 / np.tan(np.radians(view.fov) / 2))


@pytest.mark.parametrize("name", LENSES)
def test_directions_are_seen_by_opencv_at_their_pixels(name: str) -> None:
    view = named_view(name)
    pixels = np.stack(np.meshgrid(np.linspace(0.5, WIDTH - 0.5, 33), np.linspace(0.5, HEIGHT - 0.5, 25)), -1).reshape(-1, 2)
    found = np.empty((len(pixels), 4))
    undistort_points(distortion_row(view, WIDTH, HEIGHT), pixels, found)
    assert (found[:, 3] == 1).all()
    seen = opencv(LENSES[name], found[:, :3], focal_of(view), view.middle(WIDTH, HEIGHT))
    np.testing.assert_allclose(seen, pixels, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("name", LENSES)
def test_rays_are_seen_by_opencv_at_their_pixels(name: str) -> None:
    lens = LENSES[name]
    view = named_view(name)
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0.5, WIDTH - 0.5, 33), np.linspace(0.5, HEIGHT - 0.5, 25)))
    found = rays(view, x, y)
    right, up, back, eye = axes_of(view)
    np.testing.assert_allclose(found[:, :3], np.broadcast_to(eye, (len(x), 3)), atol=1e-6)
    inside = found[:, 3:6] @ np.stack([right, -up, -back]).T
    seen = opencv(lens, inside, focal_of(view), view.middle(WIDTH, HEIGHT))
    np.testing.assert_allclose(seen, np.stack([x, y], -1), atol=1e-4)
    assert (inside[:, 2] < 0).any() == (name == "wide")  # beyond a right angle from the line of sight
    straight = rays(replace(view, distortion=None), x, y)[:, 3:6]
    assert np.abs(straight - found[:, 3:6]).max() > 0.01
    settings = RenderSettings(WIDTH, HEIGHT, view)
    places = np.concatenate([eye + 7 * found[:, 3:6], np.ones((len(x), 1))], axis=1)
    np.testing.assert_allclose(projected(view, settings, places[None])[0], seen, atol=2e-4)


@pytest.mark.long
def test_a_moving_camera_and_a_near_plane_distort_as_well() -> None:
    view = replace(VIEW, distortion=LENSES["barrel"], near=0.5)
    later = replace(view, eye=(1.0, 2.0, 5.0), target=(-4.0, 0.5, 4.0))
    x, y = np.array([10.0, 320.0, 600.0]), np.array([20.0, 240.0, 400.0])
    still = rays(view, x, y)
    out = np.empty((3, 7), np.float32)
    moving = RenderSettings(WIDTH, HEIGHT, view, views=(view, replace(view, eye=(1.0, 2.0, 4.0), target=(-4.0, 0.5, 3.0)), later))
    _rays(camera_frame(moving), x.astype(np.float32), y.astype(np.float32), out)
    np.testing.assert_allclose(out[:, 3:], still[:, 3:], atol=1e-6)
    np.testing.assert_allclose(out[:, :3] - still[:, :3], np.broadcast_to([0, 0, 1], (3, 3)), atol=1e-5)
    forward = -axes_of(view)[2]
    np.testing.assert_allclose((still[:, :3] - np.array(view.eye)) @ forward, 0.5, atol=1e-6)


def test_coefficients_that_fold_back_leave_the_border_empty() -> None:
    assert None not in border_angles(replace(VIEW, distortion=LENSES["barrel"]), WIDTH, HEIGHT)
    assert None in border_angles(replace(VIEW, distortion=LensDistortion("brown", (-0.6,))), WIDTH, HEIGHT)


def test_a_view_without_distortion_has_the_json_of_earlier_releases() -> None:
    assert "distortion" not in VIEW.to_json() and VIEW.distortion is None
    distorted = replace(VIEW, distortion=LENSES["barrel"])
    assert View.from_json(json.loads(json.dumps(distorted.to_json()))) == distorted


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "model": ({"distortion": {"model": "panini"}}, "distortion has the model 'panini'; known are brown, fisheye"),
    "count": ({"distortion": {"model": "fisheye", "coefficients": [0] * 5}}, "fisheye takes at most 4 numbers"),
    "text": ({"distortion": {"model": "brown", "coefficients": ["a"]}}, "takes at most 8 numbers"),
    "infinite": ({"distortion": {"model": "brown", "coefficients": [np.inf]}}, "takes at most 8 numbers"),
    "form": ({"distortion": [0.1]}, "it takes a model and its coefficients"),
    "panorama": ({"distortion": {"model": "brown"}, "projection": "panorama"}, "of perspective cameras"),
    "aperture": ({"distortion": {"model": "brown"}, "aperture": 0.1}, "without an aperture"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_one_sentence(case: str) -> None:
    given, message = WRONG[case]
    with pytest.raises(SettingsError, match=message) as caught:
        View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), **given)
    assert caught.value.field == "distortion"
