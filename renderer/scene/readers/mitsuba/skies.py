"""Converts Mitsuba's sky and sun to Rayfarm's sky model, at the brightness of Mitsuba's.

Mitsuba's turbidity of 3 corresponds to a dust parameter of 1. Sky and sun are tinted so that the irradiance of a horizontal
plane matches Mitsuba 3.9: the sky within 9 % per channel with the sun at 10 to 85 degrees, the sun within 3 % from 30 degrees.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Environment, Image, Light, Sky, Vec3
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.values import rgb
from renderer.scene.readers.turned_sky import rotate_environment
from renderer.scene.sky import image_of_sky, sun_of_sky
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["SKIES", "sky_of"]

SKIES = ("sunsky", "sky", "sun")
_SKY, _SUN = (0.88, 1.02, 0.97), (0.495, 0.493, 0.465)  # factors from our radiance to Mitsuba's
_TURBIDITY_EXPONENT = 1.37  # exponent from turbidity to dust
_F64 = npt.NDArray[np.float64]


def sky_of(source: Element, document: Document, shelf: TextureShelf) -> tuple[Environment | None, Light | None]:
    """Returns the sky of an emitter, black below the horizon, and its sun. Each is None if the emitter does not have it."""
    world = source.matrix()[:3, :3]
    up = _unit(world @ ((0.0, 1.0, 0.0) if document.is_old else (0.0, 0.0, 1.0)))
    document.ignore(
        Sentence(
            "mitsuba-sky-model-differs",
            "{what}: rendered with Rayfarm's own sky model, at the brightness of Mitsuba's",
            what=source.description,
        )
    )
    towards = source.get("sun_direction")
    if towards is None:
        document.ignore(
            Sentence(
                "mitsuba-sun-direction-missing",
                "{what}: has no sun_direction; the sun is placed at 45 degrees",
                what=source.description,
            )
        )
        towards = up + _horizontal_direction(up)
    towards = _unit(np.asarray(towards, float))
    elevation = math.degrees(math.asin(min(max(float(towards @ up), -1.0), 1.0)))
    both = source.number("scale", 1.0)
    sky_scale = both * source.number("sky_scale", 1.0) if source.type != "sun" else 0.0
    sun_scale = both * source.number("sun_scale", 1.0) if source.type != "sky" else 0.0
    dust = min(max((source.number("turbidity", 3.0) - 1) / 2, 0.0) ** _TURBIDITY_EXPONENT, 10.0)
    r, g, b = (min(max(v, 0.0), 1.0) for v in rgb(source.get("albedo", 0.3)))
    aperture = min(max(source.number("sun_aperture", 0.5358) * source.number("sun_radius_scale", 1.0), 0.01), 30.0)
    sky = Sky(elevation, dust=dust, sun_size=aperture, ground_albedo=(r, g, b))
    return (
        _sky_above_horizon(sky, up, towards, shelf, sky_scale) if sky_scale > 0 else None,
        _sun(sky, towards, sun_scale, source.id or source.type) if sun_scale > 0 else None,
    )


def _sky_above_horizon(sky: Sky, up: _F64, towards: _F64, shelf: TextureShelf, strength: float) -> Environment:
    pixels = np.array(image_of_sky(sky))
    pixels[len(pixels) // 2 :] = 0
    # The image's centre column is below the sun: +Y is up, and -Z towards the sun.
    level = towards - up * float(towards @ up)
    back = -_unit(level) if float(np.linalg.norm(level)) > 1e-6 else -_horizontal_direction(up)
    turn = np.column_stack([np.cross(up, back), up, back])
    image = Image("sky", pixels, False)
    return Environment(_SKY, image=shelf.add(rotate_environment(image, turn)), strength=strength)


def _sun(sky: Sky, towards: _F64, strength: float, name: str) -> Light | None:
    disk = sun_of_sky(sky)
    if disk is None:
        return None
    area = math.pi * math.sin(disk.half_angle) ** 2
    r, g, b = (float(c) * area * strength * own for c, own in zip(disk.radiance, _SUN, strict=True))
    x, y, z = (-float(c) for c in towards)
    color: Vec3 = (r, g, b)
    return Light("directional", color, direction=(x, y, z), angle=sky.sun_size, seen="always", name=name)


def _horizontal_direction(up: _F64) -> _F64:
    """Returns a unit direction perpendicular to the unit vector `up`."""
    other = np.array((0.0, 0.0, -1.0) if abs(up[2]) < 0.9 else (0.0, 1.0, 0.0))
    return _unit(other - up * float(other @ up))


def _unit(vector: _F64) -> _F64:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))
