"""Builds the tables with which kernels render a scene with spectra (the setting `spectral`): renderer/arrays/spectrum.py."""

from __future__ import annotations

import weakref
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.scene import CompiledScene
from renderer.arrays.spectrum import (
    CELL_COLUMNS,
    CONDUCTOR_NODES,
    FIRST_NM,
    GIVEN_ETA,
    GIVEN_K,
    GIVEN_REFLECTANCE,
    LAST_NM,
    SpectrumTables,
    read_only_tables,
)
from renderer.scene.material import conductor_reflectance
from renderer.scene.metal_spectra import measured_indices
from renderer.scene.spectrum_tables import table_path

__all__ = ["with_spectrum"]

F64 = npt.NDArray[np.float64]
_CENTRES = (465.0, 549.0, 611.0)  # nm: centroids of blue, green and red among wavelengths, for eta and k of unnamed conductors
_COSINES = 64  # nodes of the mean reflectance over the hemisphere
_MOST_KEPT = 4
_kept: list[tuple[tuple[weakref.ref[Any], ...], SpectrumTables]] = []


def with_spectrum(scene: CompiledScene) -> CompiledScene:
    """Returns the scene with its SpectrumTables; those of the last scenes are kept, since each batch of a frame needs them."""
    arrays = scene.material, scene.material_kind, scene.given_spectrum
    for references, tables in list(_kept):
        if all(each() is array for each, array in zip(references, arrays, strict=True)):
            return scene._replace(spectrum=tables)
    conductors, numbers = _conductors(scene)
    given = scene.given_spectrum[scene.given_spectrum[:, 0] <= GIVEN_REFLECTANCE]
    stored = _stored("wavelength_cells", CELL_COLUMNS), _stored("sigmoid", 3)
    made = read_only_tables(*stored, conductors, numbers, given[:, (1, 2, 3, 0)], given[:, 4:].reshape(-1))
    alive = [entry for entry in _kept if all(each() is not None for each in entry[0])]
    _kept[:] = [*alive[1 - _MOST_KEPT :], (tuple(map(weakref.ref, arrays)), made)]
    return scene._replace(spectrum=made)


@cache
def _stored(name: str, columns: int) -> npt.NDArray[np.float32]:
    return np.asarray(np.load(table_path(name)).reshape(-1, columns), np.float32)


def _conductors(scene: CompiledScene) -> tuple[F64, npt.NDArray[np.int32]]:
    """Returns (rows of `SpectrumTables.conductor`, `material_conductor`); a row of zeros if there are no conductors."""
    numbers = np.zeros(len(scene.material), np.int32)
    wavelengths = np.linspace(FIRST_NM, LAST_NM, CONDUCTOR_NODES)
    found: list[F64] = []
    for number in np.flatnonzero(scene.material_kind == rows.CONDUCTOR):
        eta, k = (scene.material[number, first : first + 3] for first in (rows.ETA, rows.K))
        indices = _given_indices(scene, eta, k) or measured_indices(eta, k, wavelengths)
        if indices is None:
            indices = np.interp(wavelengths, _CENTRES, eta[::-1]), np.interp(wavelengths, _CENTRES, k[::-1])
        numbers[number] = len(found) * CONDUCTOR_NODES
        found.append(np.stack([*indices, _mean_reflectance(*indices)], axis=1))
    return np.concatenate(found) if found else np.zeros((CONDUCTOR_NODES, 3)), numbers


def _given_indices(scene: CompiledScene, eta: npt.NDArray[np.float32], k: npt.NDArray[np.float32]) -> tuple[F64, F64] | None:
    """Returns eta and k at CONDUCTOR_NODES wavelengths that the file gives for a conductor; None if it gives none."""
    found = []
    for kind, color in ((GIVEN_ETA, eta), (GIVEN_K, k)):
        rows_of = scene.given_spectrum
        rows_of = rows_of[(rows_of[:, 0] == kind) & (rows_of[:, 1:4] == color).all(axis=1)]
        found.extend(rows_of[:1, 4:].astype(np.float64))
    return (found[0], found[1]) if len(found) == 2 else None


def _mean_reflectance(eta: F64, k: F64) -> F64:
    """Returns (W,) the cosine-weighted mean over the hemisphere of the reflectance of conductors with indices (W,) eta + i k.

    It is rounded, since numpy's roots of complex numbers differ between hosts in the last bit.
    """
    cosine = (np.arange(_COSINES) + 0.5) / _COSINES
    means = [np.mean(2 * cosine * conductor_reflectance(cosine, e, each)) for e, each in zip(eta, k, strict=True)]
    return np.asarray(np.round(np.array(means, np.float64), 6), np.float64)
