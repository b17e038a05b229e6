"""Computes the environments named in renderer/presets.py.

Light positions use the scene's axes: +Z is the front, where automatic cameras are, +Y is up.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from renderer.errors import SceneError
from renderer.presets import PRESETS
from renderer.scene.description import F32, Environment, Image, SceneDescription, Sky
from renderer.scene.sky import PREFIX, parse_sky
from renderer.sentences import Sentence

__all__ = ["is_named", "light_by_name", "preset_image"]

_HEIGHT = 256
_Lamp = tuple[float, float, float, float, float]  # azimuth and elevation of its middle, half its width and height, radiance

# A key on the left, a larger and weaker fill on the right, one overhead, and a rim from behind.
_STUDIO: tuple[_Lamp, ...] = (
    (-48.0, 36.0, 22.0, 17.0, 7.0),
    (62.0, 22.0, 15.0, 26.0, 2.4),
    (5.0, 80.0, 34.0, 15.0, 1.2),
    (155.0, 34.0, 14.0, 12.0, 3.5),
)
_STRIPS: tuple[_Lamp, ...] = (
    (-62.0, 12.0, 6.0, 46.0, 12.0),
    (58.0, 12.0, 6.0, 46.0, 7.0),
    (180.0, 58.0, 40.0, 5.0, 6.0),
)


def is_named(name: str) -> bool:
    """Returns True if an environment name is a preset or a sky, and so needs no file."""
    return name.startswith(PREFIX) or name in PRESETS


def light_by_name(name: str, description: SceneDescription) -> None:
    """Sets a scene's environment to a preset or to "sky:ELEVATION[,AZIMUTH]". Raises SceneError if the name is neither."""
    if name.startswith(PREFIX):
        description.environment = parse_sky(name)
        return
    if name not in PRESETS:
        raise SceneError(
            Sentence(
                "light-preset-unknown",
                "There is no light preset {name}; known are {presets}",
                name=repr(name[:60]),
                presets=[*PRESETS],
            )
        )
    sky = PRESETS[name].sky
    if sky is not None:
        description.environment = Environment(sky=Sky(*sky))
    elif name == "even-white":
        description.environment = Environment()
    else:
        description.images.append(Image(name, preset_image(name), srgb=False))
        description.environment = Environment(image=len(description.images) - 1)


def preset_image(name: str) -> F32:
    """Returns a preset's equirectangular radiance, (256, 512, 3) float32, in the layout of Environment.

    Skies have no such image.
    """
    return np.repeat(_IMAGES[name]()[..., None], 3, axis=2).astype(np.float32)


def _studio() -> np.ndarray:
    _, elevation = _angles()
    up = np.sin(elevation)
    # A seamless backdrop: the floor brightens towards the horizon, and passes into a wall that darkens again above.
    wall = 0.16 + 0.44 * np.exp(-np.square(up / 0.4))
    floor = 0.16 + 0.44 * np.exp(3.2 * np.minimum(up, 0))
    return _with_lamps(np.where(up > 0, wall, floor), _STUDIO)


def _dark_studio() -> np.ndarray:
    _, elevation = _angles()
    return _with_lamps(0.02 + 0.05 * np.exp(-np.square(np.sin(elevation) / 0.25)), _STRIPS)


def _uniform_radiance() -> np.ndarray:
    return np.ones((_HEIGHT, 2 * _HEIGHT))


def _overcast() -> np.ndarray:
    """Returns the CIE overcast sky (CIE S 011, type 1), over a ground of albedo 0.2 that haze blends into the sky at the horizon.

    Radiance above the horizon: (1 + 2 sin elevation) / 3 of that at the zenith. The haze is no part of the standard: without it,
    the end of the studio's floor would be seen before a dark band.
    """
    _, elevation = _angles()
    up = np.sin(elevation)
    zenith = 9 / 7  # gives horizontal ground the irradiance of a uniform sky of radiance 1
    ground = 0.2 + (zenith / 3 - 0.2) * np.exp(4 * np.minimum(up, 0))
    return np.where(up > 0, zenith * (1 + 2 * up) / 3, ground)


_IMAGES: dict[str, Callable[[], np.ndarray]] = {
    "studio": _studio,
    "dark-studio": _dark_studio,
    "even-white": _uniform_radiance,
    "overcast": _overcast,
}


def _angles() -> tuple[np.ndarray, np.ndarray]:
    """Returns azimuth and elevation of each texel's centre in radians; azimuth 0 is +Z and 90 degrees is +X."""
    elevation = math.pi / 2 - (np.arange(_HEIGHT) + 0.5) * math.pi / _HEIGHT
    around = (np.arange(2 * _HEIGHT) + 0.5) * math.pi / _HEIGHT - math.pi  # 0 in the middle column, which looks along -Z
    shape = (_HEIGHT, 2 * _HEIGHT)
    return np.broadcast_to(math.pi - around, shape), np.broadcast_to(elevation[:, None], shape)


def _with_lamps(background: np.ndarray, lamps: tuple[_Lamp, ...]) -> np.ndarray:
    """Adds softboxes to an image: flat rectangles that face the centre, brightest in their middle, with soft edges."""
    azimuth, elevation = _angles()
    x, y, z = np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)
    lit = background
    for around, above, wide, high, radiance in lamps:
        a, e = math.radians(around), math.radians(above)
        right = (math.cos(a), 0.0, -math.sin(a))
        towards = (math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a))
        over = (-math.sin(e) * math.sin(a), math.cos(e), -math.sin(e) * math.cos(a))
        depth = x * towards[0] + y * towards[1] + z * towards[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (x * right[0] + z * right[2]) / depth / math.tan(math.radians(wide))
            v = (x * over[0] + y * over[1] + z * over[2]) / depth / math.tan(math.radians(high))
        falloff = 1 - 0.35 * np.minimum(u * u + v * v, 1)
        box = np.where(depth > 0, _soft_edge(u) * _soft_edge(v) * falloff, 0.0)
        lit = lit * (1 - box) + radiance * box
    return lit


def _soft_edge(place: np.ndarray) -> np.ndarray:
    """Returns 1 for values within -1 ... 1 and 0 outside, with a smooth transition from 0.9 to 1."""
    t = np.clip((1 - np.abs(place)) / 0.1, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))
