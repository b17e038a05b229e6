"""Tests of the reflectance of thin films at wavelengths, against the matrix method and the closed form of quarter-wave films."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.bsdf.iridescence import film_reflectance_at
from tests.renderer.kernel.bsdf.films import by_matrices

BLUE_TO_RED = np.linspace(380.0, 780.0, 201)


@entry
def _film(f0, ior, thickness, cosine, wavelengths, found):
    for k in range(len(wavelengths)):
        nm = wavelengths[k]
        found[k], _, _ = film_reflectance_at((f0, f0, f0), ior, thickness, cosine, (nm, nm, nm))


def reflectance(f0: float, ior: float, thickness: float, cosine: float, wavelengths: np.ndarray) -> np.ndarray:
    found = np.zeros(len(wavelengths), np.float32)
    _film(*map(np.float32, (f0, ior, thickness, cosine)), wavelengths.astype(np.float32), found)
    return found.astype(float)


@pytest.mark.parametrize("cosine", [1.0, np.sqrt(0.5), 0.05])
@pytest.mark.parametrize(
    ("base", "ior", "thickness"), [(1.0, 1.33, 380.0), (1.5, 1.38, 100.0), (1.5, 2.4, 900.0), (9.0, 1.5, 0.0)]
)
def test_films_have_the_reflectance_of_the_matrix_method(base: float, ior: float, thickness: float, cosine: float) -> None:
    found = reflectance(((base - 1) / (base + 1)) ** 2, ior, thickness, cosine, BLUE_TO_RED)
    np.testing.assert_allclose(found, by_matrices(base, ior, thickness, cosine, BLUE_TO_RED), atol=2e-5)


def test_a_quarter_wave_has_its_closed_form() -> None:
    base, ior, nm = 1.52, 1.38, 550.0
    wanted = ((base - ior**2) / (base + ior**2)) ** 2
    f0 = ((base - 1) / (base + 1)) ** 2
    assert reflectance(f0, ior, nm / (4 * ior), 1.0, np.array([nm]))[0] == pytest.approx(wanted, abs=1e-6)
    within = np.sqrt(1 - 0.5 / ior**2)
    at_45 = reflectance(f0, ior, nm / (4 * ior * within), np.sqrt(0.5), np.array([nm]))[0]
    sides = []
    for air, film, last in (
        (np.sqrt(0.5), ior * within, base * np.sqrt(1 - 0.5 / base**2)),
        (np.sqrt(2), ior / within, base / np.sqrt(1 - 0.5 / base**2)),
    ):
        sides.append(((air * last - film**2) / (air * last + film**2)) ** 2)
    assert at_45 == pytest.approx(np.mean(sides), abs=1e-6)


def test_a_film_half_a_wave_thick_is_not_there() -> None:
    found = reflectance(0.04, 1.4, 600.0 / 2.8, 1.0, np.array([600.0]))[0]
    assert found == pytest.approx(0.04, abs=1e-6)
