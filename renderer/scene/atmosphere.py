"""Sunlight in clear air: scattered by molecules and haze, absorbed by ozone, around a spherical earth, in 18 wavelengths.

Single scattering is integrated along each line of sight (Nishita et al., "Display of the Earth Taking into Account
Atmospheric Scattering", 1993), with an ozone layer (Bruneton, "A Qualitative and Quantitative Evaluation of 8 Clear Sky
Models", 2017). Multiple scattering is approximated as isotropic (Hillaire, "A Scalable and Production Ready Sky and Atmosphere
Rendering Technique", 2020, section 5.5). Lengths in metres. Irradiance is scaled so that the sun's luminance outside the
atmosphere is pi: a white surface facing the sun there has radiance 1.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

__all__ = ["Air", "mie_phase", "rayleigh_phase", "scattered", "transmitted"]

_EARTH, _TOP = 6_360e3, 6_460e3
_EYE = 50.0  # height of the observer
_RAYLEIGH_HEIGHT, _MIE_HEIGHT = 8_000.0, 1_200.0
_OZONE_MIDDLE, _OZONE_HALF = 25e3, 15e3
_MIE_SCATTERING, _MIE_EXTINCTION = 2.0e-5, 2.2e-5  # at the ground, per metre, for all wavelengths
_ASYMMETRY = 0.76
_SUN_RADIUS = np.radians(0.27)  # the earth's shadow fades over this angle

_MICRONS = np.arange(0.38, 0.73, 0.02)
_RAYLEIGH = 1.24062e-6 * _MICRONS**-4.0  # Bruneton's fit of Penndorf 1957, per metre at the ground
# Ozone's cross section in 1e-25 m^2 (Serdyuchenko et al. 2014, 223 K, every 20 nm), and the layer's peak for 300 Dobson units.
_OZONE_SECTION = np.array(
    [0.003, 0.015, 0.055, 0.158, 0.367, 0.775, 1.48, 2.14, 3.09, 4.27, 4.40, 5.02, 3.74, 2.66, 1.85, 1.21, 0.746, 0.511]
)
_OZONE = _OZONE_SECTION * 1e-25 * 300 * 2.687e20 / _OZONE_HALF

# The grid of heights and of the sun's elevations on which light scattered more than once is tabulated.
_HEIGHTS = np.array([0.0, 0.5, 1, 2, 4, 6, 8, 12, 16, 20, 30, 40, 60, 80, 100]) * 1e3
_SUNS = np.radians([-90.0, -15, -12, -10, -8, -6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 6, 8, 10, 15, 20, 30, 45, 60, 90])


class Air(NamedTuple):
    """Densities of molecules, dust and ozone in the air, as multiples of those on a clear day."""

    molecules: float
    dust: float
    ozone: float


def _observer_curves() -> np.ndarray:
    """Returns the CIE 1931 colour matching functions x, y and z at the 18 wavelengths, (18, 3).

    Source: the fit of Wyman, Sloan & Shirley, JCGT 2(2), 2013.
    """

    def bell(center: float, below: float, above: float) -> np.ndarray:
        nm = _MICRONS * 1000 - center
        return np.exp(-0.5 * (nm * np.where(nm < 0, below, above)) ** 2)

    x = 1.056 * bell(599.8, 0.0264, 0.0323) + 0.362 * bell(442.0, 0.0624, 0.0374) - 0.065 * bell(501.1, 0.0490, 0.0382)
    y = 0.821 * bell(568.8, 0.0213, 0.0247) + 0.286 * bell(530.9, 0.0613, 0.0322)
    z = 1.217 * bell(437.0, 0.0845, 0.0278) + 0.681 * bell(459.0, 0.0385, 0.0725)
    return np.stack([x, y, z], axis=1)


def _to_rgb() -> np.ndarray:
    """Returns the matrix (18, 3) from the transmitted fraction of sunlight per wavelength to linear Rec.709.

    Unattenuated sunlight has luminance pi.
    """
    planck = _MICRONS**-5.0 / np.expm1(14_387.77 / (_MICRONS * 5_778))
    xyz = _observer_curves() * planck[:, None]
    xyz *= np.pi / xyz[:, 1].sum()
    rgb = np.array([(3.2404542, -1.5371385, -0.4985314), (-0.9692660, 1.8760108, 0.0415560), (0.0556434, -0.2040259, 1.0572252)])
    return xyz @ rgb.T


_RGB = _to_rgb()


def _densities(height: np.ndarray) -> np.ndarray:
    """Returns the densities of molecules, dust and ozone at heights in metres, (..., 3), each relative to its maximum."""
    ozone = np.maximum(1 - np.abs(height - _OZONE_MIDDLE) / _OZONE_HALF, 0)
    return np.stack([np.exp(-height / _RAYLEIGH_HEIGHT), np.exp(-height / _MIE_HEIGHT), ozone], axis=-1)


def _distance_to_top(radius: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Returns the distance in metres from a point to the top of the atmosphere.

    radius: the point's distance to the earth's centre; cosine: of the zenith angle of the direction.
    """
    along = radius * cosine
    return -along + np.sqrt(np.maximum(along * along + _TOP**2 - radius * radius, 0))


def _column(radius: np.ndarray, cosine: np.ndarray, steps: int = 16) -> np.ndarray:
    """Returns the densities of molecules, dust and ozone integrated from a point to the top of the atmosphere, (..., 3).

    radius: the point's distance to the earth's centre; cosine: of the zenith angle of the direction. The integration steps grow
    along the ray, since air gets thinner.
    """
    edge = np.linspace(0, 1, steps + 1) ** 2
    length = _distance_to_top(radius, cosine)
    total = np.zeros((*radius.shape, 3))
    for near, far in pairwise(edge):
        t = length * (near + far) / 2
        height = np.sqrt(np.maximum(radius * radius + t * t + 2 * radius * t * cosine, 0)) - _EARTH
        total += _densities(np.maximum(height, 0)) * (length * (far - near))[..., None]
    return total


def _thickness(air: Air, column: np.ndarray) -> np.ndarray:
    """Returns the optical thickness of air at each wavelength, (..., 18).

    column: integrated densities of molecules, dust and ozone, from `_column`.
    """
    molecules, dust, ozone = (column[..., k, None] for k in range(3))
    return molecules * (air.molecules * _RAYLEIGH) + dust * (air.dust * _MIE_EXTINCTION) + ozone * (air.ozone * _OZONE)


def transmitted(air: Air, elevation: float) -> np.ndarray:
    """Returns the irradiance (3,) of direct sunlight on a surface at the ground that faces the sun, in linear Rec.709.

    elevation: of the sun, in radians.
    """
    column = _column(np.array(_EARTH + _EYE), np.array(np.sin(elevation)), steps=64)
    return np.asarray(np.maximum(np.exp(-_thickness(air, column)) @ _RGB, 0))


def rayleigh_phase(cosine: np.ndarray) -> np.ndarray:
    """Returns the Rayleigh phase function, per steradian. cosine: of the angle between the viewing direction and the sun."""
    return 3 / (16 * np.pi) * (1 + cosine * cosine)


def mie_phase(cosine: np.ndarray) -> np.ndarray:
    """Returns the phase function of dust, per steradian (Cornette & Shanks 1992).

    cosine: of the angle between the viewing direction and the sun.
    """
    g = _ASYMMETRY
    scale = 3 / (8 * np.pi) * (1 - g * g) / (2 + g * g)
    return scale * (1 + cosine * cosine) / (1 + g * g - 2 * g * cosine) ** 1.5


def scattered(
    air: Air, ground: float, sun: float, elevation: np.ndarray, azimuth: np.ndarray, steps: int = 48
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the light towards an observer on the ground: scattered once by molecules, once by dust, and more than once.

    Each of the three is (..., 3), linear Rec.709; the first two are not yet multiplied by their phase functions. ground: albedo
    of the ground. sun: elevation of the sun. elevation (...), above 0, and azimuth (...), relative to the sun's: of the viewing
    directions. Angles are in radians.
    """
    start = _EARTH + _EYE
    up = np.sin(elevation)
    towards_sun = up * np.sin(sun) + np.cos(elevation) * np.cos(sun) * np.cos(azimuth)
    again = _scattered_again(air, ground)
    molecules, dust, more = (np.zeros((*up.shape, 18)) for _ in range(3))
    for at in _integration_steps(
        np.full_like(up, start), up, np.sin(sun), towards_sun, _distance_to_top(np.full_like(up, start), up), steps
    ):
        seen = np.exp(-_thickness(air, at.passed)) * at.step[..., None]
        sunlight = seen * _sunlight(air, at.radius, at.cosine)
        molecules += sunlight * at.density[..., 0, None]
        dust += sunlight * at.density[..., 1, None]
        more += (
            seen
            * _scattering(air, at.density)
            * _interpolate_table(again, at.radius - _EARTH, np.arcsin(np.clip(at.cosine, -1, 1)))
        )
    return molecules @ (_RAYLEIGH[:, None] * air.molecules * _RGB), dust @ (_MIE_SCATTERING * air.dust * _RGB), more @ _RGB


class _Step(NamedTuple):
    """One integration step of a ray through the air, evaluated at its middle."""

    radius: np.ndarray  # from the earth's centre
    cosine: np.ndarray  # of the sun's zenith angle
    density: np.ndarray  # (..., 3)
    passed: np.ndarray  # (..., 3) densities integrated so far
    step: np.ndarray  # its length


def _integration_steps(
    start: np.ndarray, up: np.ndarray, sun_up: np.ndarray, towards_sun: np.ndarray, length: np.ndarray, steps: int
) -> Iterator[_Step]:
    """Yields the integration steps of a ray from its start; the steps' length grows along the ray.

    up, sun_up: cosines of the zenith angles of the ray and of the sun at the ray's start; towards_sun: cosine of the angle
    between ray and sun.
    """
    edge = np.linspace(0, 1, steps + 1) ** 2
    passed = np.zeros((*length.shape, 3))
    for near, far in pairwise(edge):
        t = length * (near + far) / 2
        step = length * (far - near)
        radius = np.sqrt(start**2 + t * t + 2 * start * t * up)
        density = _densities(np.maximum(radius - _EARTH, 0))
        half = density * (step / 2)[..., None]
        passed = passed + half
        yield _Step(radius, (start * sun_up + t * towards_sun) / radius, density, passed, step)
        passed = passed + half


def _sunlight(air: Air, radius: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Returns the fraction of direct sunlight that arrives at a point, per wavelength, (..., 18); 0 in the earth's shadow.

    radius: the point's distance to the earth's centre; cosine: of the sun's zenith angle there.
    """
    horizon = -np.sqrt(np.maximum(1 - (_EARTH / radius) ** 2, 0))
    risen = np.clip(0.5 + (np.arcsin(np.clip(cosine, -1, 1)) - np.arcsin(horizon)) / (2 * _SUN_RADIUS), 0, 1)
    return np.asarray(np.exp(-_thickness(air, _column(radius, np.maximum(cosine, horizon)))) * risen[..., None])


def _scattering(air: Air, density: np.ndarray) -> np.ndarray:
    """Returns the scattering coefficients of air with these densities, per metre, at each wavelength."""
    return np.asarray(density[..., 0, None] * (air.molecules * _RAYLEIGH) + density[..., 1, None] * (air.dust * _MIE_SCATTERING))


@functools.lru_cache(maxsize=4)  # independent of the sun's position
def _scattered_again(air: Air, ground: float, steps: int = 12) -> np.ndarray:
    """Returns the radiance of multiply scattered light, assumed isotropic, by height and sun elevation: (heights, suns, 18).

    Second-order scattering with a uniform phase function times 1 / (1 - f), the sum of all further orders.
    """
    cosines, weights = np.polynomial.legendre.leggauss(8)
    azimuth = (np.arange(4) + 0.5) * np.pi / 4
    radius, sun, up, turn = np.broadcast_arrays(
        (_EARTH + np.maximum(_HEIGHTS, 1.0))[:, None, None, None], _SUNS[:, None, None], cosines[:, None], azimuth
    )
    towards_sun = up * np.sin(sun) + np.sqrt(1 - up * up) * np.cos(sun) * np.cos(turn)
    below = radius * radius * (up * up - 1) + _EARTH**2
    lands = (up < 0) & (below > 0)
    length = np.where(lands, -radius * up - np.sqrt(np.maximum(below, 0)), _distance_to_top(radius, up))
    second, again = np.zeros((*up.shape, 18)), np.zeros((*up.shape, 18))
    for at in _integration_steps(radius, up, np.sin(sun), towards_sun, length, steps):
        scattering = np.exp(-_thickness(air, at.passed)) * _scattering(air, at.density) * at.step[..., None]
        second += scattering * _sunlight(air, at.radius, at.cosine) / (4 * np.pi)
        again += scattering
    landed = (radius * np.sin(sun) + length * towards_sun) / _EARTH
    lit = ground / np.pi * np.maximum(landed, 0) * lands
    on_ground = _sunlight(air, np.full_like(radius, _EARTH + 1.0), landed) * lit[..., None]
    second += np.exp(-_thickness(air, at.passed + at.density * (at.step / 2)[..., None])) * on_ground
    share = (weights / 2)[:, None, None] / len(azimuth)
    return np.asarray((second * share).sum(axis=(2, 3)) / (1 - (again * share).sum(axis=(2, 3))))


def _interpolate_table(table: np.ndarray, height: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Interpolates the table of `_scattered_again` bilinearly.

    height: of the points above the ground, in metres; sun: its elevation there, in radians.
    """
    y = np.interp(height, _HEIGHTS, np.arange(len(_HEIGHTS)))
    x = np.interp(sun, _SUNS, np.arange(len(_SUNS)))
    i, j = np.minimum(y.astype(int), len(_HEIGHTS) - 2), np.minimum(x.astype(int), len(_SUNS) - 2)
    t, s = (y - i)[..., None], (x - j)[..., None]
    low = table[i, j] * (1 - s) + table[i, j + 1] * s
    return np.asarray(low * (1 - t) + (table[i + 1, j] * (1 - s) + table[i + 1, j + 1] * s) * t)
