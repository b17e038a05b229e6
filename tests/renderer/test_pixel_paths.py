"""Tests of explaining a pixel: its samples match the film to the bit, and its path vertices are where the camera sees them."""

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.film import COLOR, SAMPLES
from renderer.pixel_paths import brightest_of_ranges, pixel_paths, projected_point
from renderer.render import render_batch
from renderer.scene.description import Material
from renderer.settings import Tile, View
from tests.renderer.builders import box, emitter, gray, scene, settings, square

VIEW = ((0, 2, 6), (0, 0.5, 0), 40)


@pytest.fixture(scope="module")
def made():
    materials = [Material(base_color=gray(0.7)), Material(kind="mirror", base_color=gray(0.9)), emitter(9.0)]
    ground, lamp = square((0, 0, 0), (9, 0, 0), (0, 0, -9), 0), square((0, 3, 0), (1, 0, 0), (0, 0, 1), 2)
    return scene(materials, (ground, box(2, 0.4, (0, 0.4, -1)), lamp), environment=0.3)


def test_pixel_samples_sum_to_the_film(made):
    asked = replace(settings(*VIEW, size=40, max_depth=6), view=View((0, 2, 6), (0, 0.5, 0), fov=40, aperture=0.2))
    film = render_batch(made, asked, Tile(16, 16, 8, 8), 0, 24).sums
    for x, y in ((16, 16), (20, 22), (23, 23)):
        found = pixel_paths(made, asked, x, y, 24, sample_number=5)
        assert list(found.sums) == film[COLOR, y - 16, x - 16].tolist()
        assert found.finite == film[SAMPLES, y - 16, x - 16] == found.samples == 24
        assert {role for path in found.paths for role in path.chosen} == {"asked", "first", "median", "brightest"}
        light = {role: sum(path.replay.value) for path in found.paths for role in path.chosen}
        assert light["brightest"] >= light["median"]
        assert next(path.sample for path in found.paths if "asked" in path.chosen) == 5


def test_pixel_without_samples_shows_the_first_sample(made):
    found = pixel_paths(made, settings(*VIEW, size=40), 3, 3, 0)
    assert (found.samples, found.sums, [path.sample for path in found.paths]) == (0, (0, 0, 0), [0])
    with pytest.raises(SettingsError, match=r"^pixel"):
        pixel_paths(made, settings(*VIEW, size=40), 40, 3, 1)


@pytest.mark.parametrize("projection", ["perspective", "orthographic", "panorama"])
def test_first_vertex_projects_into_the_pixel(made, projection):
    """A path's first vertex projects to the sample's film position, within the filter's radius."""
    view = View((0, 2, 6), (0.3, 0.5, 0), up=(0.1, 1, 0), fov=50, projection=projection, height=3, shift_x=0.2, shift_y=-0.1)
    asked = replace(settings(*VIEW, size=40, max_depth=2), view=view)
    for x, y in ((3, 9), (20, 30), (34, 22)):
        spot = pixel_paths(made, asked, x, y, 1).paths[0].spots[0]
        assert (spot.x / spot.w, spot.y / spot.w) == pytest.approx((x + 0.5, y + 0.5), abs=2.5)


def test_projection_of_points_behind_and_directions():
    view = View((0, 0, 0), (0, 0, -1), fov=90)
    assert projected_point(view, 20, 20, (1, 0, 5)).w < 0
    middle = projected_point(view, 20, 20, (0, 0, -1), is_far=True)
    assert (middle.x / middle.w, middle.y / middle.w) == (10, 10)


def test_brightest_sample_is_found_by_splitting_few_ranges() -> None:
    """The search gives the maximum, and splits only ranges that may contain it."""
    light = np.random.default_rng(3).exponential(1.0, 4096)
    light[2777] = 900.0
    split = []

    def light_of(first: int, count: int) -> np.ndarray:
        split.append(first)
        return light[first : first + count]

    ranges = [(first, 64, float(light[first : first + 64].sum())) for first in range(64, 4096, 64)]
    known = (int(np.argmax(light[:64])), float(light[:64].max()))
    assert brightest_of_ranges(known, ranges, light_of) == 2777
    assert split == [2752]
    light[2777] = 0.0
    ranges = [(first, 64, float(light[first : first + 64].sum())) for first in range(64, 4096, 64)]
    assert brightest_of_ranges(known, ranges, light_of) == int(np.argmax(light))
