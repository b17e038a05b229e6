"""The layout of the tables with which kernels render spectra (the setting `spectral`).

A path carries light at three wavelengths in place of red, green and blue: a hero wavelength and two rotations of it (Wilkie et
al., "Hero Wavelength Spectral Sampling", EGSR 2014). Light is relative to daylight (D65), so that white is 1 at every wavelength.
A wavelength is a number 0 ... 1, even from FIRST_NM to LAST_NM.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "CELLS",
    "CELL_COLUMNS",
    "CONDUCTOR_NODES",
    "FIRST_NM",
    "FIRST_SHADE",
    "GIVEN_COLUMNS",
    "GIVEN_ETA",
    "GIVEN_K",
    "GIVEN_LIGHT",
    "GIVEN_REFLECTANCE",
    "LAST_NM",
    "LAST_SHADE",
    "SHADES",
    "SIDES",
    "SpectrumTables",
    "empty_spectrum_tables",
    "read_only_tables",
]

FIRST_NM, LAST_NM = 380.0, 780.0
CELLS = 512  # intervals of the random number that chooses a wavelength
# Columns of `cell`: the wavelength at its start; what it grows by over the cell; likewise the film's linear Rec.709 response to
# light at that wavelength over the density of sampling it, three and three.
CELL_COLUMNS = 8
SHADES, SIDES = 32, 24  # nodes of the table of sigmoids: of the largest channel; of each other channel over it
FIRST_SHADE, LAST_SHADE = 0.06, 0.97  # the first and last node of the largest channel, as roots of its odds (kernel/spectrum)
CONDUCTOR_NODES = 81  # wavelengths of `conductor`, even
# Kinds of spectra that files give. Columns of CompiledScene.given_spectrum: the kind; the colour, three, by which kernels
# recognise it; its values at the wavelengths of `conductor`.
GIVEN_LIGHT, GIVEN_REFLECTANCE, GIVEN_ETA, GIVEN_K = range(4)
GIVEN_COLUMNS = 4 + CONDUCTOR_NODES


class SpectrumTables(NamedTuple):
    """The tables of a scene. All arrays are read-only."""

    cell: npt.NDArray[np.float32]  # (CELLS, CELL_COLUMNS)
    # (3 * SHADES * SIDES * SIDES, 3): a, b, c of the reflectance 1/2 + y / (2 sqrt(1 + y y)), y = (a x + b) x + c at wavelength x
    sigmoid: npt.NDArray[np.float32]
    conductor: npt.NDArray[np.float32]  # (C * CONDUCTOR_NODES, 3): eta, k, mean reflectance
    material_conductor: npt.NDArray[np.int32]  # (M,): the first row in `conductor`; 0 for other materials
    # (g, 4): colours of lights and of surfaces whose spectrum is known, and its kind. A light's largest channel is 1.
    given_color: npt.NDArray[np.float32]
    given_value: npt.NDArray[
        np.float32
    ]  # (g * CONDUCTOR_NODES,): these spectra at even wavelengths; of lights, relative to daylight


def read_only_tables(*arrays: Any) -> SpectrumTables:
    """Returns SpectrumTables of these arrays, converted to their types."""
    kinds: tuple[Any, ...] = (np.float32, np.float32, np.float32, np.int32, np.float32, np.float32)
    made: list[Any] = [np.ascontiguousarray(array, kind) for array, kind in zip(arrays, kinds, strict=True)]
    for array in made:
        array.flags.writeable = False
    return SpectrumTables(*made)


def empty_spectrum_tables() -> SpectrumTables:
    """Returns tables without rows, with the types for which kernels are compiled."""
    return read_only_tables(
        *(np.zeros((0, columns)) for columns in (CELL_COLUMNS, 3, 3)), np.zeros(0), np.zeros((0, 4)), np.zeros(0)
    )
