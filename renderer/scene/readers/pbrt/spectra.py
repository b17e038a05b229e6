"""Converts spectra and colours to linear Rec.709, as pbrt's film would show them.

pbrt renders with wavelengths. A light's RGB is its colour space's white multiplied by a smooth spectrum, so the film shows the
same RGB; any other light spectrum is scaled to a luminance of 1 and retains its colour; reflectances are converted under white
light. This renderer has three independent channels, so light that bounces repeatedly off saturated colours differs slightly.
"""

from __future__ import annotations

from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.given_spectra import GivenSpectrum, given_index, given_light, given_reflectance
from renderer.scene.observer import D65, MATCHING, at_wavelengths, planck
from renderer.scene.readers.pbrt.named_spectra import CHROMATICITIES, GLASSES, METALS
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameter, text_of
from renderer.scene.text_encoding import decoded
from renderer.sentences import Sentence

__all__ = ["SPACES", "WEIGHTS", "Colors", "balanced", "luminance"]

F64 = npt.NDArray[np.float64]

_MOST = 1e9
SPACES = ("srgb", "dci-p3", "rec2020", "aces2065-1")
# Chromaticities of red, green, blue and white.
_PRIMARIES = {
    "srgb": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)),
    "dci-p3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.3127, 0.3290)),
    "rec2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290)),
    "aces2065-1": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), (0.32168, 0.33767)),
}


def _to_xyz(space: str) -> F64:
    *primaries, white = (np.array([x / y, 1.0, (1 - x - y) / y]) for x, y in _PRIMARIES[space])
    columns = np.stack(primaries, axis=1)
    return np.asarray(columns * np.linalg.solve(columns, white))


_FROM_XYZ = np.linalg.inv(_to_xyz("srgb"))
_INTO_709 = {space: np.eye(3) if space == "srgb" else _FROM_XYZ @ _to_xyz(space) for space in SPACES}
WEIGHTS = _FROM_XYZ @ (MATCHING * D65)
WEIGHTS = WEIGHTS / WEIGHTS.sum(axis=1, keepdims=True)  # (3, W) weights of wavelengths under daylight


# Source: the cone responses of Bradford's chromatic adaptation, as CIE 160:2004 has them.
_CONES = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def balanced(kelvin: float, space: str) -> F64:
    """Returns the (3, 3) matrix, in linear Rec.709, of a film balanced for a light of a temperature in kelvins.

    Below 4000 K the light is a black body, above a phase of daylight. space: the film's colour space.
    """
    if kelvin < 4000:
        source = MATCHING @ planck(kelvin)
    else:
        t = 1000 / (kelvin * 1.4388 / 1.4380)  # the phases of daylight: CIE 015:2018, 4.1.2
        x = (
            0.244063 + t * (0.09911 + t * (2.9678 - t * 4.6070))
            if kelvin <= 7000
            else 0.237040 + t * (0.24748 + t * (1.9018 - t * 2.0064))
        )
        y = -3 * x * x + 2.87 * x - 0.275
        source = np.array([x, y, 1 - x - y])
    target = _to_xyz(space).sum(axis=1)
    gains = (_CONES @ target / target[1]) / (_CONES @ source / source[1])
    return np.asarray(_FROM_XYZ @ np.linalg.solve(_CONES, gains[:, None] * _CONES) @ _to_xyz("srgb"))


def luminance(rgb: Vec3) -> float:
    """Returns the Rec.709 luminance of a linear RGB colour."""
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


class Colors:
    """Converts colour parameters to linear Rec.709."""

    def __init__(self, files: SceneFiles, notes: Notes, spectra: list[GivenSpectrum]) -> None:
        """Initialises the conversion. spectra: receives the spectra of the colours (renderer/scene/given_spectra.py)."""
        self._files, self._notes, self._spectra = files, notes, spectra

    def light(self, found: Parameter | None) -> Vec3:
        """Returns the linear RGB of a light's colour parameter at scale 1; white if the parameter is None."""
        if found is None:
            return 1.0, 1.0, 1.0
        if found.type == "rgb":
            return self._clamp_to_gamut(_INTO_709[found.space] @ self._rgb_of(found), found)
        if found.type == "blackbody":
            kelvin = float(np.asarray(found.value, float).reshape(-1)[:1].sum())
            if not 0 < kelvin < 1e9:
                raise found.place.error(
                    Sentence("pbrt-blackbody-temperature-invalid", "the temperature of a blackbody must be above 0 kelvin")
                )
            return self._light_color(planck(kelvin), found)
        name = text_of(found)
        if name in CHROMATICITIES:
            x, y = CHROMATICITIES[name]
            return self._clamp_to_gamut(_FROM_XYZ @ np.array([x / y, 1.0, (1 - x - y) / y]), found)
        return self._light_color(self.spectrum(found), found)

    def albedo(self, found: Parameter) -> Vec3:
        """Returns the linear RGB of a reflectance parameter, clamped to 0..1. Raises SceneError for a blackbody."""
        if found.type == "rgb":
            into = _INTO_709[found.space]
            rgb = (into @ self._rgb_of(found)) / into.sum(axis=1)
        elif found.type == "blackbody":
            raise found.place.error(
                Sentence(
                    "pbrt-blackbody-as-colour", "a blackbody is a spectrum of light, not of a surface; give an rgb or a spectrum"
                )
            )
        else:
            spectrum = self.spectrum(found)
            rgb = WEIGHTS @ spectrum
        r, g, b = (float(min(max(v, 0.0), 1.0)) for v in rgb)
        if found.type != "rgb" and np.ptp(spectrum) > 0:
            self._spectra.append(given_reflectance((r, g, b), spectrum))
        return r, g, b

    def numbers(self, found: Parameter) -> Vec3:
        """Returns the red, green and blue values of a parameter that is not a colour, such as an index of refraction."""
        if found.type == "float":
            value = float(np.asarray(found.value, float).reshape(-1)[:1].sum())
            return value, value, value
        r, g, b = (float(v) for v in (self._rgb_of(found) if found.type == "rgb" else WEIGHTS @ self.spectrum(found)))
        return r, g, b

    def index(self, found: Parameter | None) -> tuple[float, float]:
        """Returns an index of refraction, and its dispersion as 20 / Abbe number; (1.5, 0) if the parameter is None."""
        if found is None:
            return 1.5, 0.0
        name = text_of(found)
        if name in GLASSES:
            ior, abbe = GLASSES[name]
            return ior, 20 / abbe
        _, green, _ = self.numbers(found)
        return green, 0.0

    def spectrum(self, found: Parameter) -> F64:
        """Returns the values (W,) of a spectrum parameter at WAVELENGTHS.

        The parameter is a single number, pairs of wavelength and value, or the name of a file of such pairs.
        """
        if isinstance(found.value, np.ndarray):
            values = found.value.reshape(-1)
            if len(values) == 1:
                return np.full(len(D65), values[0])
        else:
            values = self._file(text_of(found), found)
        if len(values) < 2 or len(values) % 2:
            raise found.place.error(
                Sentence(
                    "pbrt-spectrum-malformed",
                    "a spectrum needs pairs of a wavelength in nanometres and a value",
                )
            )
        return at_wavelengths(values[::2], values[1::2])

    def _file(self, file_name: str, found: Parameter) -> F64:
        metal = file_name.removeprefix("metal-").rpartition("-")
        if metal[0] in METALS and metal[2] in ("eta", "k"):
            raise found.place.error(
                Sentence("pbrt-spectrum-is-ior", "{name} is an index of refraction, not a colour", name=repr(file_name[:60]))
            )
        name = self._files.find(file_name, found.place.file)
        if name is None:
            raise found.place.error(
                Sentence(
                    "pbrt-spectrum-unknown",
                    "{name} is neither a known spectrum nor a file of the scene; add the file",
                    name=repr(PurePosixPath(file_name).name[:80]),
                )
            )
        words = [line.partition("#")[0].split() for line in decoded(self._files.read(name)).splitlines()]
        try:
            values = np.array([float(word) for line in words for word in line])
        except ValueError:
            raise found.place.error(
                Sentence(
                    "pbrt-spectrum-file-malformed",
                    "{name} contains words in place of numbers; the file of a spectrum needs pairs of numbers",
                    name=name,
                )
            ) from None
        if not np.isfinite(values).all():
            raise found.place.error(
                Sentence("pbrt-spectrum-file-not-finite", "{name} contains numbers that are not finite", name=name)
            )
        return values

    def _light_color(self, spectrum: F64, found: Parameter) -> Vec3:
        xyz = MATCHING @ spectrum
        if not xyz[1] > 0:
            raise found.place.error(
                Sentence(
                    "pbrt-light-spectrum-invisible",
                    "the spectrum of a light has no visible part; give one between 380 and 780 nanometres",
                )
            )
        rgb = self._clamp_to_gamut(_FROM_XYZ @ (xyz / xyz[1]), found)
        self._spectra.append(given_light(rgb, spectrum))
        return rgb

    def conductor(self, eta: Vec3, k: Vec3, etas: F64, ks: F64) -> None:
        """Notes the spectra (W,) of a conductor with a given eta and k at red, green and blue."""
        self._spectra.extend(given_index(eta, k, etas, ks))

    def _clamp_to_gamut(self, rgb: F64, found: Parameter) -> Vec3:
        if rgb.min() < -1e-3 * max(float(rgb.max()), 1e-9):
            self._notes.add(
                found.place,
                Sentence(
                    "pbrt-colour-outside-gamut",
                    "A colour outside of the gamut of Rec.709 is replaced by the nearest one inside",
                ),
            )
        r, g, b = (float(min(max(v, 0.0), _MOST)) for v in rgb)
        return r, g, b

    @staticmethod
    def _rgb_of(found: Parameter) -> F64:
        values = np.asarray(found.value, float).reshape(-1)
        if len(values) != 3:
            raise found.place.error(Sentence("pbrt-rgb-malformed", "an rgb needs three numbers"))
        return values
