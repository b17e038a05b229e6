"""Generates the tables of spectral rendering that no scene changes: sigmoid.npy and wavelength_cells.npy in this folder.

They are stored because all hosts must render the same bits. `python -m renderer.scene.spectrum_tables` writes them, in half a
minute; tests compare colours of the tables with the film's.

Jakob and Hanika, "A Low-Dimensional Function Space for Efficient Spectral Upsampling" (Eurographics 2019): a reflectance is a
sigmoid of a quadratic polynomial of the wavelength, whose coefficients are fitted so that it has the colour in daylight.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from renderer.arrays.spectrum import CELL_COLUMNS, CELLS, FIRST_NM, FIRST_SHADE, LAST_NM, LAST_SHADE, SHADES, SIDES
from renderer.scene.observer import DAYLIGHT_WEIGHTS, WAVELENGTHS

__all__ = ["main", "reflectances", "shades", "sides", "sigmoid_table", "table_path", "wavelength_cells"]

F64 = npt.NDArray[np.float64]
_STEPS = 40  # of Gauss-Newton, from the coefficients of the neighbouring shade
_MOST = 200.0  # bound of the polynomial's values, so that neither black nor white is infinite
_DAMPING = 1e-7

_PLACES = (WAVELENGTHS - FIRST_NM) / (LAST_NM - FIRST_NM)
_POWERS = np.stack([_PLACES**2, _PLACES, np.ones_like(_PLACES)])  # (3, W)


def table_path(name: str) -> Path:
    """Returns the path of a stored table, "sigmoid" or "wavelength_cells"."""
    return Path(__file__).with_name(f"{name}.npy")


def _by_odds(t: F64) -> F64:
    """Returns t^2 / (t^2 + (1 - t)^2), 0 to 1: for even t, values that are denser near 0 and 1."""
    return np.asarray(t**2 / (t**2 + (1 - t) ** 2))


def shades() -> F64:
    """Returns (SHADES,) the nodes of the largest channel."""
    return _by_odds(np.linspace(FIRST_SHADE, LAST_SHADE, SHADES))


def sides() -> F64:
    """Returns (SIDES,) the nodes of each other channel over the largest."""
    return _by_odds(np.linspace(0.0, 1.0, SIDES))


def reflectances(coefficients: F64) -> F64:
    """Returns the reflectances (..., W) at the observer's wavelengths of coefficients (..., 3)."""
    y = coefficients @ _POWERS
    return np.asarray(0.5 + 0.5 * y / np.sqrt(1 + y * y))


def _fitted(rgb: F64, start: F64) -> F64:
    """Returns the coefficients (n, 3) of reflectances with the colours (n, 3), by damped Gauss-Newton from `start`."""
    found = start.copy()
    best, least = found.copy(), np.full(len(rgb), np.inf)
    damping = np.full(len(rgb), _DAMPING)
    for _ in range(_STEPS):
        y = found @ _POWERS
        root = 1 / np.sqrt(1 + y * y)
        residual = (0.5 + 0.5 * y * root) @ DAYLIGHT_WEIGHTS.T - rgb
        error = (residual**2).sum(axis=1)
        better = error < least
        best[better], least[better] = found[better], error[better]
        damping = np.where(better, np.maximum(damping * 0.2, _DAMPING), damping * 20)
        found = best.copy()
        y = found @ _POWERS
        root = 1 / np.sqrt(1 + y * y)
        residual = (0.5 + 0.5 * y * root) @ DAYLIGHT_WEIGHTS.T - rgb
        slope = np.einsum("nw,cw,kw->nck", 0.5 * root**3, DAYLIGHT_WEIGHTS, _POWERS, optimize=True)
        normal = np.einsum("nck,ncj->nkj", slope, slope)
        scale = np.einsum("nkk->n", normal)[:, None, None] * np.eye(3)
        gradient = np.einsum("nck,nc->nk", slope, residual)
        step = np.linalg.solve(normal + damping[:, None, None] * scale + 1e-30 * np.eye(3), gradient[..., None])[..., 0]
        found = found - step
        most = np.abs(found @ _POWERS).max(axis=1, keepdims=True)
        found *= np.minimum(1.0, _MOST / np.maximum(most, 1e-12))
    return best


def sigmoid_table() -> F64:
    """Returns (3, SHADES, SIDES, SIDES, 3) coefficients by the index of the largest channel, and the nodes of the channels.

    The channels after the largest one, in the order red, green, blue, red, are divided by it. The last index is that of the
    first of them.
    """
    side = sides()
    second, first = np.meshgrid(side, side, indexing="ij")
    unit = np.stack([np.ones_like(first), first, second], axis=-1).reshape(-1, 3)
    colors = np.stack([np.roll(unit, k, axis=1) for k in range(3)])  # largest channel k, then k + 1, k + 2
    table = np.zeros((3, SHADES, SIDES * SIDES, 3))
    nodes = shades()
    for walk in (range(SHADES // 2, SHADES), range(SHADES // 2 - 1, -1, -1)):
        found = np.zeros((3 * SIDES * SIDES, 3)) if walk.start == SHADES // 2 else table[:, SHADES // 2].reshape(-1, 3)
        for k in walk:
            found = _fitted((colors * nodes[k]).reshape(-1, 3), found)
            table[:, k] = found.reshape(3, -1, 3)
    return table.reshape(3, SHADES, SIDES, SIDES, 3)


def wavelength_cells() -> F64:
    """Returns (CELLS, CELL_COLUMNS) the cells of the random number that chooses a wavelength.

    Wavelengths are sampled by the sum of the absolute responses of the film's three channels to daylight, linear between the
    observer's wavelengths. The mean of the response over all random numbers is 1 in each channel: white light is white.
    """
    fine = np.linspace(FIRST_NM, LAST_NM, 8001)
    weights = np.stack([np.interp(fine, WAVELENGTHS, each) for each in DAYLIGHT_WEIGHTS])
    density = np.abs(weights).sum(axis=0)
    density += 0.02 * density.max()
    cdf = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
    ends = np.interp(np.linspace(0.0, 1.0, CELLS + 1), cdf / cdf[-1], fine)
    ends[0], ends[-1] = FIRST_NM, LAST_NM
    response = np.stack([np.interp(ends, WAVELENGTHS, each) for each in DAYLIGHT_WEIGHTS], axis=1)
    found = np.zeros((CELLS, CELL_COLUMNS))
    places = (ends - FIRST_NM) / (LAST_NM - FIRST_NM)
    found[:, 0], found[:, 1] = places[:-1], np.diff(places)
    over_density = np.diff(ends)[:, None] * CELLS  # nanometres per random number
    start, end = response[:-1] * over_density, response[1:] * over_density
    mean = ((start + end) / 2).mean(axis=0)
    found[:, 2:5], found[:, 5:8] = start / mean, (end - start) / mean
    return found


def main() -> None:
    """Writes the tables."""
    np.save(table_path("sigmoid"), sigmoid_table().astype(np.float32))
    np.save(table_path("wavelength_cells"), wavelength_cells().astype(np.float32))


if __name__ == "__main__":
    main()
