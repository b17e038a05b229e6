"""Conductors: complex indices eta + i k at red, green and blue that match the spectrum's reflectance at normal incidence."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Vec3
from renderer.scene.readers.metals import normal_reflectance
from renderer.scene.readers.pbrt.named_spectra import METALS
from renderer.scene.readers.pbrt.parameters import Parameter, text_of
from renderer.scene.readers.pbrt.spectra import WEIGHTS, Colors

__all__ = ["absorbing", "index_of", "index_of_reflectance"]

F64 = npt.NDArray[np.float64]
_BRIGHTEST = 0.9999  # pbrt's limit
_BRIGHTEST_METAL = 0.998


def index_of(eta: Parameter | None, k: Parameter | None, colors: Colors) -> tuple[Vec3, Vec3]:
    """Returns RGB eta and k of a conductor; those of copper if neither parameter is given."""
    names = [text_of(each) if each is not None else "" for each in (eta, k)]
    if eta is None and k is None:
        names = ["metal-Cu-eta", "metal-Cu-k"]
    metals = [_metal(name, part) for name, part in zip(names, ("eta", "k"), strict=True)]
    if metals[0] is not None and metals[0] == metals[1]:
        return METALS[metals[0]]
    if eta is not None and k is not None and {eta.type, k.type} == {"spectrum"} and not any(metals):
        etas, ks = colors.spectrum(eta), colors.spectrum(k)
        matched = _match_reflectance(etas, ks)
        colors.conductor(*matched, etas, ks)
        return matched
    found = []
    for part, metal, parameter in zip((0, 1), metals, (eta, k), strict=True):
        if metal is not None or parameter is None:
            found.append(METALS[metal or "Cu"][part])
        else:
            found.append(colors.numbers(parameter))
    return found[0], found[1]


def _metal(name: str, part: str) -> str | None:
    middle = name.removeprefix("metal-").removesuffix(f"-{part}")
    return middle if name == f"metal-{middle}-{part}" and middle in METALS else None


def _match_reflectance(eta: F64, k: F64) -> tuple[Vec3, Vec3]:
    mean = np.maximum(WEIGHTS @ eta, 1e-3)
    wanted = np.clip(WEIGHTS @ normal_reflectance(eta, k), 0.0, _BRIGHTEST_METAL)  # gold is outside Rec.709's gamut
    square = (wanted * (mean + 1) ** 2 - (mean - 1) ** 2) / (1 - wanted)
    # If no k reflects so little, eta is changed instead.
    root = np.sqrt(wanted)
    mean = np.where(square < 0, (1 + root) / (1 - root), mean)
    return _vec(mean), _vec(np.sqrt(np.maximum(square, 0)))


def index_of_reflectance(rgb: Vec3) -> tuple[Vec3, Vec3]:
    """Returns the index of a metal with a given reflectance at normal incidence, as pbrt chooses it: eta = 1 and a matching k."""
    return (1.0, 1.0, 1.0), _vec(absorbing(np.array(rgb)))


def absorbing(reflectance: npt.NDArray[Any]) -> F64:
    """Returns the k with which a metal of eta = 1 has the given reflectance at normal incidence."""
    values = np.clip(np.asarray(reflectance, np.float64), 0.0, _BRIGHTEST)
    return np.asarray(2 * np.sqrt(values) / np.sqrt(1 - values))


def _vec(values: F64) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
