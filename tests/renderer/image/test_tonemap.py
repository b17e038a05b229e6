"""Tests of tone curves: values computed by hand from their sources, and properties that all curves share."""

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.image import tonemap

GREYS = np.repeat(np.linspace(0, 20, 2001, dtype=np.float32)[:, None], 3, axis=1)


@pytest.mark.parametrize(
    ("curve", "radiance", "expected"),
    [
        ("neutral", (0.5, 0.5, 0.5), (0.46, 0.46, 0.46)),  # below the compression only Fresnel's 0.04 is subtracted
        ("neutral", (0.04, 0.04, 0.04), (0.01, 0.01, 0.01)),  # the toe: 6.25 x^2
        ("neutral", (1.04, 1.04, 1.04), (1 - 0.24**2 / 0.48,) * 3),
        ("srgb", (0.25, 1.0, 7.0), (0.25, 1.0, 1.0)),
        ("hue", (0.25, 0.5, 1.0), (0.25, 0.5, 1.0)),
        ("hue", (8.0, 4.0, 1.0), (1.0, 0.5, 0.125)),
        ("reinhard", (1.0, 1.0, 1.0), (0.5, 0.5, 0.5)),
        ("reinhard", (1.0, 0.0, 0.0), (1 / 1.2126, 0.0, 0.0)),
        ("filmic", (1.0, 1.0, 1.0), (2.54 / 3.16,) * 3),
        ("agx", (0.18, 0.18, 0.18), (0.2145,) * 3),  # AgX maps middle grey to about 0.5 in 2.2 encoding
    ],
)
def test_known_values(curve, radiance, expected):
    found = getattr(tonemap, curve)(np.array([radiance], np.float32))[0]
    assert found == pytest.approx(expected, abs=5e-3 if curve == "agx" else 1e-6)


@pytest.mark.parametrize("curve", tonemap.CURVES)
def test_curves_rise_from_black_to_white_and_keep_grey_grey(curve):
    shown = tonemap.apply(GREYS[None], 0.0, curve)[0].astype(int)
    assert shown[0].max() <= 1
    assert (np.diff(shown, axis=0) >= 0).all()
    assert np.ptp(shown, axis=1).max() <= 1
    assert shown[-1].min() >= 225


def test_the_hue_preserving_clip_keeps_the_ratios_of_a_pixels_channels():
    rgb = np.exp2(np.random.default_rng(2).uniform(-6, 6, (1000, 3))).astype(np.float32)
    shown = tonemap.hue(rgb)
    np.testing.assert_allclose(shown / shown.max(axis=1, keepdims=True), rgb / rgb.max(axis=1, keepdims=True), rtol=1e-6)
    np.testing.assert_allclose(shown.max(axis=1), np.minimum(rgb.max(axis=1), 1), rtol=1e-6)


def test_exposure_is_in_stops():
    rgb = np.random.default_rng(1).random((4, 5, 3), np.float32)
    np.testing.assert_array_equal(tonemap.apply(rgb, 2.0, "agx"), tonemap.apply(rgb * 4, 0.0, "agx"))


@pytest.mark.parametrize("curve", tonemap.CURVES)
def test_nan_and_negative_are_black_and_infinity_is_white(curve):
    shown = tonemap.apply(np.array([[[np.nan] * 3, [-1.0] * 3, [np.inf] * 3]], np.float32), 0.0, curve)
    assert shown[0, 0].max() <= 1
    assert shown[0, 1].max() <= 1
    assert shown[0, 2].min() >= 254


def test_middle_grey_in_srgb_is_the_standards_value():
    assert tonemap.apply(np.full((1, 1, 3), 0.18, np.float32), 0.0, "srgb")[0, 0].tolist() == [118, 118, 118]


def test_unknown_curve_error_lists_the_curves():
    with pytest.raises(SettingsError, match="neutral"):
        tonemap.apply(np.zeros((1, 1, 3), np.float32), 0.0, "sepia")


def test_straight_alpha_has_the_display_values_of_what_covers_the_pixel():
    """A half covered pixel has the colour of a covered one; where nothing is covered there is none, and alpha is linear."""
    color = np.array([0.9, 0.3, 0.05], np.float32)
    alpha = np.array([[0, 0.25, 0.5, 1, np.nan, 1.5]], np.float32)
    pixels = tonemap.apply_straight(color * np.array([0, 0.25, 0.5, 1, 1, 1], np.float32)[None, :, None], alpha, 0.5, "agx")
    whole = tonemap.apply(color[None, None], 0.5, "agx")[0, 0]
    assert pixels[0, :, 3].tolist() == [0, 64, 128, 255, 0, 255]
    assert not pixels[0, [0, 4], :3].any()
    assert (np.abs(pixels[0, 1:4, :3].astype(int) - whole) <= 1).all()
