"""Tests of environment presets: irradiance, direction, and that each is available."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.presets import PRESETS
from renderer.scene.description import SceneDescription
from renderer.scene.environment import tabulate_environment
from renderer.scene.presets import light_by_name, preset_image
from tests.grids import grid


def tables(name):
    description = SceneDescription(name="scene")
    light_by_name(name, description)
    return tabulate_environment(description)


@pytest.mark.long
@grid("name", PRESETS)
def test_preset_irradiance_is_near_white_light(name):
    found = tables(name)
    assert np.isfinite(found.radiance).all()
    assert found.radiance.min() >= 0
    assert 0.03 < found.mean < 2


def onto_ground(image):
    """Returns the irradiance on a horizontal plane divided by pi."""
    rows, columns, _ = image.shape
    up = np.sin(np.pi / 2 - (np.arange(rows) + 0.5) * np.pi / rows)
    weight = np.sqrt(1 - up * up) * np.pi / rows * 2 * np.pi / columns * np.maximum(up, 0)
    return float((image[..., 0] * weight[:, None]).sum() / np.pi)


def test_overcast_sky_irradiance():
    assert onto_ground(preset_image("overcast")) == pytest.approx(onto_ground(preset_image("even-white")), rel=1e-3)
    assert onto_ground(preset_image("even-white")) == pytest.approx(1, rel=1e-3)
    sky = preset_image("overcast")[..., 0]
    assert sky[0, 0] / sky[127, 0] == pytest.approx(3, rel=0.02)  # zenith to horizon


@grid("name", ["studio", "overcast"])
def test_no_band_is_seen_beyond_the_floor(name):
    # The studio's floor ends 30 diagonals of the scene away: 2 degrees below the horizon of a camera one diagonal above it.
    rows = np.median(preset_image(name)[..., 0], axis=1)  # of 0.7 degrees
    assert rows[128:131] == pytest.approx(np.full(3, rows[127]), rel=0.15)
    assert rows[-1] < 0.6 * rows[127]


def test_studio_key_light_is_on_the_left():
    image = preset_image("studio")[..., 0]
    y, x = np.unravel_index(image.argmax(), image.shape)
    phi, elevation = (x + 0.5) * np.pi / 256 - np.pi, np.pi / 2 - (y + 0.5) * np.pi / 256
    assert np.sin(phi) * np.cos(elevation) < -0.3  # towards -X
    assert -np.cos(phi) * np.cos(elevation) > 0.3  # towards +Z, the front
    assert np.sin(elevation) > 0.3


def test_unknown_preset_error_lists_the_presets():
    with pytest.raises(SceneError, match=r"candle.*studio"):
        light_by_name("candle", SceneDescription(name="scene"))
