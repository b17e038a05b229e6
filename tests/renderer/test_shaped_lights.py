"""Tests of lights with profiles and projected images: the irradiance of a floor below them in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.luminance import REC_709
from renderer.scene.description import EmissionMap, Light
from renderer.scene.emission_maps import emission_frames, flux_of, tabulate_emission
from renderer.scene.punctual import tabulate_punctual
from renderer.scene.readers.ies import read_ies
from renderer.scene.readers.light_maps import all_around, projected_map
from tests.renderer.builders import gray, scene
from tests.renderer.scene.ies_files import ies, looked_up
from tests.renderer.test_punctual import FLOOR, WHITE, assert_irradiance, irradiance

RANDOM = np.random.default_rng(3)
WEB = read_ies(
    ies(np.arange(0, 91, 5.0), np.arange(0, 361, 15.0), lambda theta, phi: 500 * np.cos(np.radians(theta)) + 2 * phi), "a"
)


def web(theta, phi):
    """Returns the intensity of WEB at angles in degrees, interpolated linearly."""
    angles = np.arange(0, 91, 5.0)
    return np.interp(theta, angles, 500 * np.cos(np.radians(angles))) + 2 * phi


@pytest.mark.parametrize(("theta", "phi"), [(0.5, 45), (15, 0), (30, 90), (45, 200), (70, 330)])
def test_profile_irradiance(theta, phi):
    """The irradiance of a floor is E = I(theta, phi) cos(theta) / d^2, with plane C0 along X and C90 along -Z."""
    a, b, height = math.radians(theta), math.radians(phi), 2.0
    at = height * math.tan(a) * math.cos(b), 0.0, -height * math.tan(a) * math.sin(b)
    lamp = Light("point", (1.0, 0.5, 2.0), (0, height, 0), (0, -1, 0), emission=WEB.emission)
    expected = web(theta, phi) * math.cos(a) ** 3 / height**2
    assert_irradiance(irradiance(lamp, at=at), expected * np.array([1.0, 0.5, 2.0]), rtol=2e-3)


def test_profile_of_a_tilted_light():
    """A tilted light's profile is looked up by the angle to its axis and the azimuth from its up vector."""
    for direction, up in (((0.3, -1, 0.2), (0, 0, 1)), ((1, -0.4, 0), (0, 1, 0)), ((0, -1, 0), (1, 0, 0))):
        f = np.array(direction) / np.linalg.norm(direction)
        r = np.cross(f, up)
        r /= np.linalg.norm(r)
        place = np.array((0.4, 1.5, -0.3))
        towards = -place / np.linalg.norm(place)
        theta = math.degrees(math.acos(f @ towards))
        phi = math.degrees(math.atan2(np.cross(r, f) @ towards, r @ towards)) % 360
        lamp = Light("point", gray(1.0), tuple(place), direction, emission=WEB.emission, up=up)
        expected = (web(theta, phi) if theta < 90 else 0.0) * -towards[1] / (place @ place)
        assert_irradiance(irradiance(lamp), expected, rtol=2e-3)


@pytest.mark.parametrize("kind", ["window", "screen"])
def test_projected_image_is_upright(kind):
    """An image of four colours is projected upright onto a floor: red at the upper left, for a viewer with -Z up."""
    pixels = np.array([[[4, 0, 0], [0, 3, 0]], [[0, 0, 2], [1, 1, 1]]], np.float32).repeat(64, axis=0).repeat(64, axis=1)
    lamp = Light("point", gray(5.0), (0, 2, 0), (0, -1, 0), emission=projected_map(pixels, 1.0, 0.5, kind), up=(0, 0, -1))
    for x, z, color in ((-0.5, -0.25, (4, 0, 0)), (0.5, -0.25, (0, 3, 0)), (-0.7, 0.3, (0, 0, 2)), (0.3, 0.4, (1, 1, 1))):
        cosine = 1 / math.sqrt(1 + x * x + z * z)
        expected = 5.0 * np.array(color) / 4 * (cosine**3 if kind == "window" else 1.0)
        assert_irradiance(irradiance(lamp, at=(2 * x, 0, 2 * z)), expected, rtol=1e-3)
    for x, z in ((-1.02, 0), (1.02, 0), (0, 0.52), (0, -0.52)):
        assert_irradiance(irradiance(lamp, at=(2 * x, 0, 2 * z)), 0.0)


def test_panoramic_emission_is_upright():
    """A panorama's centre is in the light's up direction, its right half to the right of this, its top along the axis."""
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[:32] = 1.0
    pixels[:, 64:, 0] += 2.0
    emission = all_around(pixels)
    # The axis is Y and up is Z, so the panorama's middle faces -Z, and +X is to the right of it.
    local = [(x, z, y) for x, y, z in ((0.1, 0.5, -1), (-0.1, 0.5, -1), (0.1, -0.5, -1), (-0.1, -0.5, -1))]
    np.testing.assert_allclose(looked_up(emission, local)[:, 0], [3, 1, 2, 0])
    np.testing.assert_allclose(looked_up(emission, local)[:, 1], [1, 1, 0, 0])


def test_spot_with_image_is_dark_beyond_its_cone():
    picture = projected_map(np.full((4, 4, 3), 2.0, np.float32), 2.0, 2.0)
    lamp = Light("spot", gray(3.0), (0, 1, 0), (0, -1, 0), inner_cone=29.9, outer_cone=30.0, emission=picture)
    assert_irradiance(irradiance(lamp), 6.0)
    assert_irradiance(irradiance(lamp, at=(math.tan(math.radians(31)), 0, 0)), 0.0)


@pytest.mark.parametrize("facing", [False, True])
def test_profile_of_a_lamp_with_radius(facing):
    """A profile shapes the light of a lamp with a radius like that of a point light, whether it is a sphere or a facing disk."""
    lamp = Light("point", gray(4.0), (0, 3, 0), (0, -1, 0), emission=WEB.emission, up=(0, 0, -1), radius=0.05, facing=facing)
    at = (0.0, 0.0, -math.tan(math.radians(20)) * 3)
    expected = 4.0 * web(20, 90) * math.cos(math.radians(20)) ** 3 / 9
    assert_irradiance(irradiance(lamp, at=at, spp=256), expected, rtol=1e-2)


def test_light_power_includes_the_map_flux():
    """A light's power is its map's flux, and its bounds in the light tree contain all of its light."""
    half = read_ies(ies([0.0, 90.0], [0.0], lambda theta, phi: 100 + 0 * theta), "half")
    lamp = Light("point", (3.0, 2.0, 1.0), (1, 2, 3), (0, 0, 1), emission=half.emission)
    maps = [half.emission]
    found = tabulate_punctual([lamp], np.zeros((2, 3), np.float32), maps, tabulate_emission(maps))
    assert found.power[0] == pytest.approx(2 * math.pi * 100 * float(np.dot((3, 2, 1), REC_709)), rel=1e-5)
    assert math.pi / 2 <= found.bounds.spread[0] < math.pi / 2 + 0.02
    assert found.bounds.intensity[0] == pytest.approx(100 * float(np.dot((3, 2, 1), REC_709)), rel=2e-2)
    turning = replace(lamp, keys=tuple(replace(lamp, direction=(math.sin(a), 0, math.cos(a))) for a in (-0.4, 0.0, 0.4)))
    wider = tabulate_punctual([turning], np.zeros((2, 3), np.float32), maps, tabulate_emission(maps))
    assert wider.bounds.spread[0] == pytest.approx(found.bounds.spread[0] + 0.4, abs=1e-3)


@pytest.mark.parametrize(
    ("emission", "expected"),
    [
        (
            projected_map(np.ones((8, 8, 3), np.float32), 1.0, 1.0),
            4 * math.asin(1 / 2),
        ),  # a pyramid of 90 degrees: a sixth of all directions
        (projected_map(np.ones((9, 5, 3), np.float32), 0.5, 2.0, "screen"), 4.0),  # irradiance integrated over the area
        (all_around(np.ones((16, 32, 3), np.float32)), 4 * math.pi),
    ],
)
def test_flux_is_the_integral_over_directions(emission, expected):
    np.testing.assert_allclose(flux_of(emission), expected, rtol=1e-3)


def test_flux_matches_the_lookup():
    """The computed flux of a light map equals the mean of its values in random directions, within four standard errors."""
    local = RANDOM.normal(size=(200_000, 3))
    picture = RANDOM.random((7, 5, 3), np.float32)
    for emission in (
        WEB.emission,
        projected_map(picture, 1.5, 0.7),
        projected_map(picture, 0.8, 1.2, "screen"),
        all_around(picture),
    ):
        found = looked_up(emission, local).astype(float) * 4 * math.pi
        error = found.std(axis=0) / math.sqrt(len(local))
        assert (np.abs(found.mean(axis=0) - flux_of(emission)) < 4.5 * error + 2e-3 * flux_of(emission)).all()


def test_shared_emission_map_is_stored_once():
    lamps = [Light("point", gray(1.0), (k, 2, 0), emission=WEB.emission) for k in range(5)]
    made = scene([WHITE], (FLOOR,), lights=(*lamps, Light("point")))
    assert len(made.emission_map) == 1 and list(made.emission_frame[:, 3]) == [0, 0, 0, 0, 0, -1]
    assert len(emission_frames([Light("point")], [])) == 0


def test_distant_lights_have_no_emission_map():
    with pytest.raises(SceneError, match="only point and spot lights may have one"):
        irradiance(Light("directional", direction=(0, -1, 0), emission=WEB.emission))
    with pytest.raises(SceneError, match="has no direction"):
        irradiance(Light("point", direction=(0, 0, 0), emission=WEB.emission))


def test_emission_map_of_one_texel():
    lamp = Light("point", gray(2.0), (0, 1, 0), emission=EmissionMap("sphere", np.full((1, 1, 3), 3.0, np.float32), (0, 7, 0, 4)))
    assert_irradiance(irradiance(lamp), 6.0)
