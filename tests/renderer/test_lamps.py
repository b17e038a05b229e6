"""Tests of lamps that camera rays pass through, and of objects hidden from the camera, in rendered pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.film import ALBEDO, DEPTH, NORMAL, OBJECT, SAMPLES, Sums, mean
from renderer.render import render_frame
from renderer.scene.description import Material
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, square
from tests.renderer.judge import assert_mean, mean_and_error

WHITE, MIRROR = Material(base_color=gray(0.8)), Material(kind="mirror", base_color=gray(1.0))
LAMP = emitter(4.0, lamp=True, unseen=True)
FLOOR = square((0, 0, 0), (20, 0, 0), (0, 0, -20), 0)
VIEW = View((0.0, 2.0, 6.0), (0.0, 1.0, 0.0), fov=40.0)
BEFORE = square((0, 1.4, 2.0), (0.5, 0, 0), (0, 0.4, 0), 1)  # in the camera's line of sight, facing the camera
ABOVE = square((0, 3.0, 0), (1, 0, 0), (0, 0, 1), 1)  # faces down
HIGHER = square((0, 3.5, 0), (1, 0, 0), (0, 0, 1), 2)
PATH = {"light_samples": 2}  # an option for which the kernel traces one path at a time


def picture(materials: list[Material], *meshes: object, spp: int = 64, view: View = VIEW, **more: object) -> Sums:
    asked: dict[str, object] = {"max_depth": 4, "filter": "box", **more}
    return render_frame(scene(materials, meshes), RenderSettings(48, 32, view, **asked), spp)


def planes(sums: Sums) -> np.ndarray:
    return np.concatenate([sums[ALBEDO], sums[NORMAL], sums[DEPTH : DEPTH + 1], sums[OBJECT : OBJECT + 1]])


@pytest.mark.parametrize(
    "kernel",
    [
        {},
        PATH,
        pytest.param({"integrator": "whitted"}, marks=pytest.mark.long),
        pytest.param({"integrator": "ao"}, marks=pytest.mark.long),
    ],
)
def test_camera_sees_behind_a_hidden_lamp(kernel: dict[str, object]) -> None:
    """The first-hit planes show the surface behind a lamp that is hidden from the camera, as if the lamp did not exist."""
    with_lamp = picture([WHITE, LAMP], FLOOR, BEFORE, spp=4, **kernel)
    without = picture(
        [WHITE, emitter(4.0)], FLOOR, replace(BEFORE, positions=BEFORE.positions + np.float32(100)), spp=4, **kernel
    )
    assert (planes(with_lamp) == planes(without)).all()
    assert without[OBJECT].any()
    assert not without[OBJECT].all()


@grid("kernel", [{}, PATH])
def test_hidden_lamp_lights_like_a_visible_one(kernel: dict[str, object]) -> None:
    below = View((0.3, 2.0, 0.4), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=30.0)
    sums = picture([WHITE, emitter(4.0)], FLOOR, ABOVE, view=below, max_depth=2, spp=256)
    body, _ = mean_and_error(sums)
    assert_mean(picture([WHITE, LAMP], FLOOR, ABOVE, view=below, max_depth=2, spp=256, **kernel), body, slack=2e-3)


@pytest.mark.parametrize("kernel", [{}, PATH, pytest.param({"integrator": "whitted"}, marks=pytest.mark.long)])
def test_mirror_shows_hidden_lamp_and_background(kernel: dict[str, object]) -> None:
    """A mirror shows a hidden lamp together with the light behind it, of another lamp or an emissive surface."""
    down = View((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=10.0)
    wall = square((0, 5.0, 0), (3, 0, 0), (0, 0, 3), 3)
    materials = [MIRROR, LAMP, emitter(2.0, lamp=True, unseen=True), emitter(0.5)]
    found = mean(picture(materials, FLOOR, ABOVE, HIGHER, wall, view=down, spp=4, **kernel), 24)
    np.testing.assert_allclose(found, 6.5, rtol=1e-5)


@pytest.mark.long
def test_hidden_lamp_casts_no_shadow() -> None:
    """A hidden lamp casts no shadow: a floor below two lamps, one in front of the other, receives the light of both."""
    down = View((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=20.0)

    def lit(*radiance: float, kernel: dict[str, object]) -> Sums:
        lamps = [emitter(each, lamp=True, unseen=True) for each in radiance]
        return picture([WHITE, *lamps], FLOOR, ABOVE, HIGHER, view=down, max_depth=2, spp=512, **kernel)

    parts = [mean_and_error(lit(4.0, 0.0, kernel={})), mean_and_error(lit(0.0, 3.0, kernel={}))]
    expected = sum(part[0] for part in parts)
    for kernel in ({}, PATH):
        assert_mean(lit(4.0, 3.0, kernel=kernel), expected, slack=3 * max(part[1] for part in parts) / expected + 1e-4)


def test_visible_pass_through_lamp_adds_to_the_background() -> None:
    """The camera sees the sum of a visible pass-through lamp and what is behind it; the first hit is the object behind."""
    lamp = emitter(4.0, lamp=True)
    found = picture([emitter(1.0), lamp], FLOOR, BEFORE, spp=4, max_depth=1)
    light = mean(found, 24)[..., 0]
    assert set(np.unique(np.round(light, 4))) >= {1.0, 5.0}
    hidden = picture([emitter(1.0), LAMP], FLOOR, BEFORE, spp=4, max_depth=1)
    np.testing.assert_allclose(planes(found), planes(hidden), rtol=1e-4, atol=100)  # the distance is the sum of two parts


def test_hidden_object_casts_a_shadow() -> None:
    """An object hidden from the camera casts its shadow and is visible in a mirror."""
    ball = Material(base_color=gray(0.0), unseen=True)
    blocker = square((0, 1.0, 0), (8, 0, 0), (0, 0, -8), 2)
    down = View((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=20.0)
    lamp = square((0, 3.0, 0), (0.2, 0, 0), (0, 0, 0.2), 1)
    sums = picture([WHITE, emitter(9.0), ball], FLOOR, lamp, blocker, view=down, max_depth=2, spp=16)
    assert (sums[OBJECT] == 1).all()
    assert not mean(sums, 24).any()
    shining = Material(base_color=gray(0.0), emission=gray(2.0), unseen=True)
    turned = square((0, 1.0, 0), (8, 0, 0), (0, 0, 8), 2)
    seen = picture([MIRROR, emitter(9.0), shining], FLOOR, lamp, turned, view=down, spp=4)
    np.testing.assert_allclose(mean(seen, 24), 2.0, rtol=1e-5)
    assert (seen[SAMPLES] == 4).all()
