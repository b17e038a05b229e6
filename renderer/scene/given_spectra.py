"""Spectra that scene files give for lights, reflectances and metals, which spectral rendering uses in place of smooth ones.

The description keeps colours as linear Rec.709. A given spectrum belongs to the colour that a reader has made of it, and kernels
recognise it by that: a light by its chromaticity, so that its power may be scaled. A colour that a texture or a tint has changed
becomes a smooth spectrum again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.spectrum import GIVEN_COLUMNS, GIVEN_ETA, GIVEN_K, GIVEN_LIGHT, GIVEN_REFLECTANCE
from renderer.luminance import luminance
from renderer.scene.observer import D65, DAYLIGHT_WEIGHTS, planck
from renderer.settings import Vec3

__all__ = [
    "MOST_GIVEN",
    "GivenSpectrum",
    "black_body",
    "black_body_light",
    "given_index",
    "given_light",
    "given_reflectance",
    "spectrum_rows",
]

F64 = npt.NDArray[np.float64]
MOST_GIVEN = 64  # spectra of a scene; further ones are smooth


class GivenSpectrum(NamedTuple):
    """The spectrum of a colour.

    kind: GIVEN_LIGHT ... (renderer/arrays/spectrum.py). values: (W,) at the observer's wavelengths.
    """

    kind: int
    color: Vec3
    values: tuple[float, ...]


def _given(kind: int, color: Vec3, values: F64) -> GivenSpectrum:
    return GivenSpectrum(kind, color, tuple(float(v) for v in values))


def given_light(color: Vec3, radiance: F64) -> GivenSpectrum:
    """Returns the spectrum of lights of a chromaticity. radiance: (W,), of any scale; lights keep their colour's luminance."""
    relative = np.maximum(radiance, 0.0) / D65
    shown = luminance(DAYLIGHT_WEIGHTS @ relative)
    most = max(color)
    if not (shown > 0 and most > 0):
        return _given(GIVEN_LIGHT, (0.0, 0.0, 0.0), relative)
    r, g, b = (c / most for c in color)
    return _given(GIVEN_LIGHT, (r, g, b), relative * (luminance(np.array((r, g, b))) / shown))


def black_body(color: Vec3, kelvin: float) -> GivenSpectrum:
    """Returns the spectrum of lights of a temperature in kelvins. color: in which they are rendered in RGB."""
    return given_light(color, planck(kelvin))


def black_body_light(radiance: Vec3, kelvin: float, spectra: list[GivenSpectrum]) -> Vec3:
    """Returns a light with a temperature in kelvins, and adds its spectrum to `spectra`.

    Grey light gets the colour of the black body at the same luminance; other light has its colour already.
    """
    red, green, blue = radiance
    if red == green == blue:
        body = np.maximum(DAYLIGHT_WEIGHTS @ (planck(kelvin) / D65), 0.0)
        red, green, blue = (float(c) for c in red * body / luminance(body))
    spectra.append(black_body((red, green, blue), kelvin))
    return red, green, blue


def given_reflectance(color: Vec3, reflectance: F64) -> GivenSpectrum:
    """Returns the spectrum of surfaces of a colour. reflectance: (W,), which is clipped to 0 ... 1."""
    return _given(GIVEN_REFLECTANCE, color, np.clip(reflectance, 0.0, 1.0))


def given_index(eta: Vec3, k: Vec3, etas: F64, ks: F64) -> tuple[GivenSpectrum, GivenSpectrum]:
    """Returns the spectra, (W,) each, of conductors with a given eta and k at red, green and blue."""
    return _given(GIVEN_ETA, eta, etas), _given(GIVEN_K, k, ks)


def spectrum_rows(spectra: list[GivenSpectrum]) -> npt.NDArray[np.float32]:
    """Returns (g, GIVEN_COLUMNS) the rows of CompiledScene.given_spectrum.

    They are the first of each kind and colour, at most MOST_GIVEN.
    """
    found: dict[tuple[int, Vec3], GivenSpectrum] = {}
    for each in spectra:
        if max(each.color) > 0:
            found.setdefault((each.kind, each.color), each)
    rows = [(each.kind, *each.color, *each.values) for each in list(found.values())[:MOST_GIVEN]]
    return np.array(rows, np.float32).reshape(len(rows), GIVEN_COLUMNS)
