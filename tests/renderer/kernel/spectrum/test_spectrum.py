"""Tests of spectral rendering's formulas: colours survive the way to wavelengths and back, white stays white, glass disperses."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.arrays.spectrum import CELL_COLUMNS, FIRST_NM, LAST_NM, SHADES, SIDES
from renderer.jit import entry
from renderer.kernel.spectrum.indices import dispersed_index
from renderer.luminance import luminance
from renderer.scene.given_spectra import black_body, given_reflectance
from renderer.scene.observer import D65, DAYLIGHT_WEIGHTS, WAVELENGTHS, planck
from renderer.scene.spectrum_tables import reflectances, shades, sides, wavelength_cells
from tests.renderer.kernel.spectrum.colors import CELLS, SIGMOIDS, at_wavelengths, cells, to_rgb, wavelengths


@entry
def glass(dispersion, wavelengths, found):
    for k in range(len(wavelengths)):
        found[k] = dispersed_index(np.float32(1.5168), dispersion, wavelengths[k])


def test_white_is_white_and_greys_are_flat() -> None:
    assert CELLS.shape[1] == CELL_COLUMNS
    np.testing.assert_allclose(CELLS[:, 2:5].mean(0) + CELLS[:, 5:8].mean(0) / 2, 1, atol=1e-6)
    np.testing.assert_allclose(CELLS, wavelength_cells(), rtol=1e-5, atol=1e-6)
    greys = np.repeat([[0.0], [0.18], [1.0]], 3, axis=1)
    values = at_wavelengths(greys)
    np.testing.assert_array_equal(values, np.broadcast_to(greys.astype(np.float32)[:, None], values.shape))
    np.testing.assert_allclose(to_rgb(values), greys, atol=2e-4)


def test_table_has_the_colors_of_its_nodes() -> None:
    side = sides()
    for k in range(3):
        wanted = np.zeros((SHADES, SIDES, SIDES, 3))
        wanted[..., k], wanted[..., (k + 1) % 3], wanted[..., (k + 2) % 3] = 1, side, side[:, None]
        wanted *= shades()[:, None, None, None]
        found = reflectances(SIGMOIDS[k, ::5].astype(float)) @ DAYLIGHT_WEIGHTS.T
        np.testing.assert_allclose(found, wanted[::5], atol=2.5e-3)


def test_wavelengths_are_those_of_their_cells() -> None:
    number, share = cells()
    np.testing.assert_allclose(wavelengths(), CELLS[number, 0] + share * CELLS[number, 1], atol=1e-4)


def test_colors_survive_the_way_through_wavelengths() -> None:
    colors = np.random.default_rng(1).random((500, 3))
    values = at_wavelengths(colors)
    error = np.abs(to_rgb(values) - colors)
    assert error.mean() < 6e-4
    assert error.max() < 0.003
    assert values.min() >= 0
    assert values.max() <= 1.001
    lights = colors * [[9.0, 2.0, 0.5]]
    found = to_rgb(at_wavelengths(lights, is_light=True))
    np.testing.assert_allclose(found / lights.max(axis=1, keepdims=True), lights / lights.max(axis=1, keepdims=True), atol=0.003)


@pytest.mark.parametrize("abbe", [64.17, 30.0])
def test_glass_disperses_by_its_abbe_number(abbe: float) -> None:
    lines = np.array([486.13, 587.56, 656.27])
    index = np.zeros(3, np.float32)
    glass(np.float32(20 / abbe), ((lines - FIRST_NM) / (LAST_NM - FIRST_NM)).astype(np.float32), index)
    assert index[1] == pytest.approx(1.5168, abs=1e-5)
    assert (index[1] - 1) / (index[0] - index[2]) == pytest.approx(abbe, rel=1e-3)


@pytest.mark.parametrize("kelvin", [1000.0, 2700.0, 9000.0])
def test_lights_with_a_temperature_have_plancks_spectrum(kelvin: float) -> None:
    """Whatever their power, with the luminance of the colour; other lights of the scene stay smooth."""
    color = np.maximum(DAYLIGHT_WEIGHTS @ (planck(kelvin) / D65), 0.0)
    color = color / luminance(color)
    given = [black_body((1.0, 0.5, 0.25), 5000.0), black_body(tuple(color), kelvin)]
    lights = np.array([color, 123.0 * color, (9.0, 4.0, 1.0)])
    values = at_wavelengths(lights, True, given)
    nm = FIRST_NM + (LAST_NM - FIRST_NM) * wavelengths()
    wanted = np.interp(nm, WAVELENGTHS, planck(kelvin) / D65)
    wanted /= luminance(to_rgb(wanted))
    np.testing.assert_allclose(values[0], wanted, rtol=0.01 if kelvin < 2000 else 2e-3, atol=1e-4)
    np.testing.assert_allclose(values[1], 123 * values[0], rtol=1e-5)
    np.testing.assert_array_equal(values[2], at_wavelengths(lights[2:], True)[0])
    if kelvin > 2000:  # inside Rec.709's gamut
        np.testing.assert_allclose(to_rgb(values[0]), color, rtol=0.004, atol=0.004)


def test_surfaces_keep_the_spectrum_that_a_file_gives() -> None:
    """A narrow band of green, against the smooth reflectance of the same colour."""
    band = np.where(np.abs(WAVELENGTHS - 540) < 30, 0.8, 0.05)
    red, green, blue = (float(c) for c in np.clip(DAYLIGHT_WEIGHTS @ band, 0, 1))
    found, smooth = (
        at_wavelengths([(red, green, blue)], given=given)[0] for given in ([given_reflectance((red, green, blue), band)], [])
    )
    nm = FIRST_NM + (LAST_NM - FIRST_NM) * wavelengths()
    np.testing.assert_allclose(found, np.interp(nm, WAVELENGTHS, band), atol=2e-3)
    assert np.abs(found - smooth).max() > 0.3
