"""Colours at all wavelengths by the kernel's formulas, and the film's colour of a spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from renderer.arrays.spectrum import CONDUCTOR_NODES, SpectrumTables, read_only_tables
from renderer.jit import entry
from renderer.kernel.spectrum.upsampling import light, reflectance
from renderer.kernel.spectrum.wavelengths import sample_wavelengths
from renderer.scene.given_spectra import GivenSpectrum, spectrum_rows
from renderer.scene.spectrum_tables import table_path

__all__ = ["CELLS", "SIGMOIDS", "at_wavelengths", "cells", "to_rgb", "wavelengths"]

CELLS = np.load(table_path("wavelength_cells"))
SIGMOIDS = np.load(table_path("sigmoid"))
_COUNT = 512
_NUMBERS = ((np.arange(_COUNT) + 0.5) / _COUNT).astype(np.float32)


@entry
def _spectra(tables, colors, numbers, is_light, wavelengths, values):
    for k in range(len(numbers)):
        x = sample_wavelengths(tables, numbers[k])
        wavelengths[k, 0], wavelengths[k, 1], wavelengths[k, 2] = x
        for i in range(len(colors)):
            rgb = colors[i, 0], colors[i, 1], colors[i, 2]
            found = light(tables, rgb, x) if is_light else reflectance(tables, rgb, x)
            values[i, k, 0], values[i, k, 1], values[i, k, 2] = found


def _tables(given: Sequence[GivenSpectrum] = ()) -> SpectrumTables:
    rows = spectrum_rows(list(given))
    tables = CELLS, SIGMOIDS.reshape(-1, 3), np.zeros((CONDUCTOR_NODES, 3)), np.zeros(1)
    return read_only_tables(*tables, rows[:, (1, 2, 3, 0)], rows[:, 4:].reshape(-1))


def at_wavelengths(
    colors: np.ndarray | Sequence[Sequence[float]], is_light: bool = False, given: Sequence[GivenSpectrum] = ()
) -> np.ndarray:
    """Returns (m, n, 3) the values of m colours at the wavelengths of n random numbers. given: spectra of colours."""
    rgb = np.array(colors, np.float32)
    values, places = np.zeros((len(rgb), _COUNT, 3), np.float32), np.zeros((_COUNT, 3), np.float32)
    _spectra(_tables(given), rgb, _NUMBERS, is_light, places, values)
    return values.astype(float)


def wavelengths() -> np.ndarray:
    """Returns (n, 3) the wavelengths, 0 ... 1, of `at_wavelengths`."""
    values, places = np.zeros((0, _COUNT, 3), np.float32), np.zeros((_COUNT, 3), np.float32)
    _spectra(_tables(), np.zeros((0, 3), np.float32), _NUMBERS, False, places, values)
    return places.astype(float)


def cells() -> tuple[np.ndarray, np.ndarray]:
    """Returns (number of the cell, place in it 0 ... 1) of each random number and rotation, (n, 3) each."""
    place = (_NUMBERS[:, None] + np.arange(3) / 3) % 1 * len(CELLS)
    number = np.minimum(place.astype(int), len(CELLS) - 1)
    return number, place - number


def to_rgb(values: np.ndarray) -> np.ndarray:
    """Returns (..., 3) the film's linear Rec.709 of light (..., n, 3) at the wavelengths of `at_wavelengths`."""
    number, share = cells()
    weights = CELLS[number, 2:5] + share[..., None] * CELLS[number, 5:8]
    return np.asarray(np.einsum("...kr,krc->...c", values, weights) / (3 * _COUNT))
