"""Computes skies as environments: an image of the sky above illuminated ground, and the sun as a disk."""

from __future__ import annotations

import functools
import math
from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.luminance import luminance
from renderer.scene.atmosphere import Air, mie_phase, rayleigh_phase, scattered, transmitted
from renderer.scene.description import F32, Environment, Sky
from renderer.sentences import Sentence

__all__ = ["PREFIX", "Sun", "image_of_sky", "parse_sky", "sun_of_sky"]

PREFIX = "sky:"
_HEIGHT = 512
_ELEVATIONS, _AZIMUTHS = 96, 48  # size of the grid on which the atmosphere is integrated
_RANGES = {
    "sun_elevation": (-90.0, 90.0),
    "sun_azimuth": (-1e6, 1e6),
    "air": (0.0, 10.0),
    "dust": (0.0, 10.0),
    "ozone": (0.0, 10.0),
    "sun_size": (0.01, 30.0),
}


class Sun(NamedTuple):
    """The sun: an infinitely distant disk of constant radiance."""

    direction: np.ndarray  # (3,) unit, towards it, before the environment's rotation
    half_angle: float  # radians
    radiance: np.ndarray  # (3,) linear Rec.709


def parse_sky(text: str) -> Environment:
    """Returns the environment of "sky:ELEVATION[,AZIMUTH]", in degrees. Raises SceneError for other text."""
    try:
        numbers = [float(part) for part in text.removeprefix(PREFIX).split(",")]
    except ValueError:
        numbers = []
    if not text.startswith(PREFIX) or not 1 <= len(numbers) <= 2:
        raise SceneError(
            Sentence(
                "sky-malformed",
                "The sky is {text}; give the sun's elevation and optionally its azimuth, as sky:30,120",
                text=repr(text[:60]),
            )
        )
    sky = Sky(numbers[0], numbers[1] if len(numbers) == 2 else 0.0)
    _check(sky)
    return Environment(sky=sky)


def sun_of_sky(sky: Sky) -> Sun | None:
    """Returns the sun as seen from the ground; None if it is switched off or below the horizon.

    While it sets, the fraction of the disk below the horizon dims the whole disk, so that its irradiance decreases continuously.
    """
    _check(sky)
    elevation, azimuth, half = (math.radians(x) for x in (sky.sun_elevation, sky.sun_azimuth, sky.sun_size / 2))
    risen = _area_fraction_above(math.sin(max(-math.pi / 2, min(math.pi / 2, elevation))) / math.sin(half))
    irradiance = transmitted(_air(sky), max(elevation, 0.0)) * risen
    if not sky.sun or not irradiance.any():
        return None
    level = math.cos(elevation)
    direction = np.array([level * math.sin(azimuth), math.sin(elevation), -level * math.cos(azimuth)])
    return Sun(direction, half, irradiance / (math.pi * math.sin(half) ** 2))


def image_of_sky(sky: Sky) -> F32:
    """Returns the equirectangular radiance of a sky, as `_image` does; cached, for animated scenes with a constant sky."""
    return _image(astuple(sky))


@functools.lru_cache(maxsize=2)
def _image(values: tuple[Any, ...]) -> F32:
    """Returns equirectangular radiance without the sun's disk, (512, 1024, 3). values: the fields of a Sky.

    Below the horizon is ground lit by sun and sky. The layout is that of Environment: azimuth 0 is the middle column. Raises
    SceneError if a number is out of its range.
    """
    sky = Sky(*values)
    _check(sky)
    sun = math.radians(sky.sun_elevation)
    grid_elevation = math.pi / 2 * np.linspace(0, 1, _ELEVATIONS) ** 2  # finest at the horizon
    grid_azimuth = np.linspace(0, math.pi, _AZIMUTHS)
    albedo = float(luminance(np.array(sky.ground_albedo)))
    molecules, dust, more = scattered(_air(sky), albedo, sun, *np.meshgrid(grid_elevation, grid_azimuth, indexing="ij"))

    rows = _HEIGHT // 2
    elevation = math.pi / 2 - (np.arange(rows) + 0.5) * math.pi / _HEIGHT
    azimuth = (np.arange(2 * _HEIGHT) + 0.5) * math.pi / _HEIGHT - math.pi - math.radians(sky.sun_azimuth)
    apart = np.abs((azimuth + math.pi) % (2 * math.pi) - math.pi)
    cosine = np.sin(elevation)[:, None] * math.sin(sun) + np.cos(elevation)[:, None] * math.cos(sun) * np.cos(apart)
    place = (np.sqrt(elevation / (math.pi / 2)) * (_ELEVATIONS - 1), apart / math.pi * (_AZIMUTHS - 1))
    above = (
        _interpolated(molecules, *place) * rayleigh_phase(cosine)[..., None]
        + _interpolated(dust, *place) * mie_phase(cosine)[..., None]
        + _interpolated(more, *place)
    )
    above = np.maximum(above, 0)
    solid_angle = np.cos(elevation) * math.pi / _HEIGHT * math.pi / _HEIGHT
    onto_ground = (above.sum(axis=1) * (solid_angle * np.sin(elevation))[:, None]).sum(axis=0)
    disk = sun_of_sky(sky)
    if disk is not None:
        onto_ground = onto_ground + disk.radiance * math.pi * math.sin(disk.half_angle) ** 2 * max(math.sin(sun), 0.0)
    ground = np.broadcast_to(np.array(sky.ground_albedo) / math.pi * onto_ground, above.shape)
    image = np.concatenate([above, ground]).astype(np.float32)
    image.flags.writeable = False
    return image


def _air(sky: Sky) -> Air:
    return Air(sky.air, sky.dust, sky.ozone)


def _area_fraction_above(height: float) -> float:
    """Returns the fraction of a unit disk's area that is above a line `height` below its centre."""
    if abs(height) >= 1:
        return float(height > 0)
    return 0.5 + (height * math.sqrt(1 - height * height) + math.asin(height)) / math.pi


def _interpolated(grid: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Returns the grid (m, n, 3) interpolated bilinearly at fractional rows (h,) and columns (w,): (h, w, 3)."""
    upper = np.minimum(row.astype(int), grid.shape[0] - 2)
    left = np.minimum(column.astype(int), grid.shape[1] - 2)
    t = (row - upper)[:, None, None]
    lines = grid[upper] * (1 - t) + grid[upper + 1] * t
    s = (column - left)[:, None]
    return np.asarray(lines[:, left] * (1 - s) + lines[:, left + 1] * s)


def _check(sky: Sky) -> None:
    for name, (least, most) in _RANGES.items():
        value = getattr(sky, name)
        if not least <= value <= most:
            raise SceneError(
                Sentence(
                    "sky-value-out-of-range",
                    "The sky's {name} is {value}; it must be from {least} to {most}",
                    name=name,
                    value=f"{value:g}",
                    least=f"{least:g}",
                    most=f"{most:g}",
                )
            )
    if not all(0 <= c <= 1 for c in sky.ground_albedo):
        raise SceneError(
            Sentence(
                "sky-ground-albedo-invalid",
                "The sky's ground_albedo is {ground_albedo}; it must be from 0 to 1",
                ground_albedo=sky.ground_albedo,
            )
        )
