"""Tests of spectral rendering's formulas: colours survive the way to wavelengths and back, white stays white, glass disperses."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.arrays.spectrum import CELL_COLUMNS, FIRST_NM, LAST_NM, SHADES, SIDES
from renderer.jit import entry
from renderer.kernel.spectrum.indices import dispersed_index
from renderer.scene.observer import DAYLIGHT_WEIGHTS
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
