"""What there is of a frame beside colour: the values of each plane, its channels in an EXR, and how it looks on a screen.

The film holds all of them but motion, which is a pass of its own (renderer/vectors.py).

Channels are named as Blender and Cycles name theirs, so that compositors recognise them.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from renderer import film
from renderer.errors import SettingsError
from renderer.film import Sums

__all__ = ["AOVS", "MOTION", "NAMES", "channels", "known", "layers", "planes", "size", "span", "values", "visible"]

F32 = npt.NDArray[np.float32]
Span = tuple[F32 | np.float32, F32 | np.float32] | None

_MEANS: dict[str, slice | int] = {
    "albedo": film.ALBEDO,
    "normal": film.NORMAL,
    "depth": film.DEPTH,
    "position": film.POSITION,
}
_PLAIN = {"object": film.OBJECT, "material": film.MATERIAL, "samples": film.SAMPLES}
_CHANNELS = {
    "albedo": ("Denoising Albedo.R", "Denoising Albedo.G", "Denoising Albedo.B"),
    "normal": ("Normal.X", "Normal.Y", "Normal.Z"),
    "depth": ("Depth.Z",),
    "position": ("Position.X", "Position.Y", "Position.Z"),
    "object": ("IndexOB.X",),
    "material": ("IndexMA.X",),
    "samples": ("Debug Sample Count.X",),
    "error": ("Standard Error.X",),  # ours: Cycles has none
    "motion": ("Vector.X", "Vector.Y", "Vector.Z", "Vector.W"),
}
MOTION = "motion"
NAMES = tuple(_CHANNELS)
AOVS = tuple(name for name in NAMES if name != MOTION)  # those of the film

# Of a heat map: black body, with a blue beginning so that little is told from nothing.
_HEAT = np.array([(0, 0, 0), (50, 25, 120), (190, 45, 100), (250, 140, 35), (255, 250, 195)], np.float32) / 255
_GOLDEN = 0.6180339887498949  # hues this far apart never come close to an earlier one soon


def known(names: Iterable[str]) -> list[str]:
    """The AOVs that a list of names means, `all` for every one of the film. Raises SettingsError for one that is not known."""
    wanted = list(names)
    for name in wanted:
        if name not in (*NAMES, "all"):
            raise SettingsError(f"aov {name!r} is not known; known are {', '.join(NAMES)}, or all (but motion)")
    return [*AOVS, *({MOTION} & {*wanted})] if "all" in wanted else wanted


def planes(name: str) -> tuple[int, ...]:
    """The planes of a film that an AOV's values, or `color`, are made of."""
    if name == "error":
        return _numbers(film.COLOR, film.COLOR_HALF, film.SAMPLES, film.SAMPLES_HALF)
    if name == "color":
        return _numbers(film.COLOR, film.SAMPLES)
    return _numbers(_PLAIN[name]) if name in _PLAIN else _numbers(_MEANS[name], film.SAMPLES)


def _numbers(*channels: slice | int) -> tuple[int, ...]:
    return tuple(i for each in channels for i in (range(film.CHANNELS)[each] if isinstance(each, slice) else (each,)))


def size(name: str) -> int:
    """How many values a pixel of an AOV, or of `color`, has."""
    return 3 if name == "color" else len(_CHANNELS[name])


def channels(name: str) -> tuple[str, ...]:
    """An AOV's channels in an EXR."""
    return _CHANNELS[name]


def values(sums: Sums, film_exponent: int, name: str) -> F32:
    """The values of an AOV of the film: (h, w, 3) float32 for albedo, normal and position, else (h, w).

    albedo 0 ... 1; normal, position, depth in the world; object, material: 1 + the number, 0 where nothing is hit; samples:
    those that count; error: the standard error of the pixel's luminance (film.error).
    """
    if name == "error":
        return film.error(sums, film_exponent)
    if name in _PLAIN:
        return sums[_PLAIN[name]].astype(np.float32)
    return film.mean(sums, film_exponent, _MEANS[name])


def layers(pictures: dict[str, F32]) -> dict[str, F32]:
    """AOVs by name as an EXR's channels by name, each (h, w)."""
    found = {}
    for name, plane in pictures.items():
        for i, channel in enumerate(_CHANNELS[name]):
            found[channel] = plane if plane.ndim == 2 else plane[..., i]
    return found


def span(name: str, plane: F32) -> Span:
    """The values of a whole plane between which it is shown: parts of it that are shown by themselves then go together.

    Positions and depths: the least and the greatest; samples and error: 0 and the greatest, of errors the 99th percentile.
    None for what needs none.
    """
    if name == "position":
        return plane.min(axis=(0, 1)), plane.max(axis=(0, 1))
    if name == "depth":
        hit = plane > 0
        return (np.float32(plane[hit].min()), np.float32(plane[hit].max())) if hit.any() else (np.float32(0), np.float32(1))
    if name == MOTION:
        return np.float32(0), np.abs(plane).max(initial=np.float32(0))
    if name in ("samples", "error"):
        finite = plane[np.isfinite(plane)]
        top = 0.0 if not finite.size else finite.max() if name == "samples" else np.percentile(finite, 99)
        return np.float32(0), np.float32(top)
    return None


def visible(name: str, plane: F32, between: Span = None) -> npt.NDArray[np.uint8]:
    """An AOV as (h, w, 3) uint8 to look at.

    albedo as colour; normals from -1 ... 1; positions and depths over the picture's own range, near light and nothing black;
    ids in colours that stay; samples and error as heat maps; motion, to the next frame's place, about grey: red to the right,
    green upwards. between: `span` of the whole, where the plane is a part of it.
    """
    low, high = between or span(name, plane) or (np.float32(0), np.float32(1))
    if name == "albedo":
        from renderer.image.tonemap import encode_srgb

        shown = encode_srgb(np.clip(plane, 0, 1))
    elif name == "normal":
        shown = plane * 0.5 + 0.5
    elif name == "position":
        shown = np.asarray((plane - low) / np.maximum(high - low, 1e-30), np.float32)
    elif name == MOTION:
        way = np.concatenate([-plane[..., 2:], np.zeros_like(plane[..., :1])], axis=2)
        shown = np.asarray(0.5 + 0.5 * way / max(float(high), 1e-30), np.float32)
    elif name == "depth":
        near = 1 - 0.9 * (plane - low) / max(high - low, 1e-30)
        shown = np.repeat(np.where(plane > 0, near, 0)[..., None], 3, axis=2)
    elif name in ("object", "material"):
        shown = _palette(plane.astype(np.int64))
    else:
        shown = _heat(np.where(np.isfinite(plane), plane, high).astype(np.float32) / np.float32(max(float(high), 1e-30)))
    return (np.clip(np.nan_to_num(shown), 0, 1) * 255 + 0.5).astype(np.uint8)


def _palette(ids: npt.NDArray[np.int64]) -> F32:
    """A colour for every number, the same in every picture; black for 0."""
    found, where = np.unique(ids, return_inverse=True)
    colors = [colorsys.hsv_to_rgb(i * _GOLDEN % 1, 0.45 + 0.3 * (i % 2), 0.95 - 0.25 * (i // 2 % 2)) for i in found.tolist()]
    table = np.array(colors, np.float32)
    table[found == 0] = 0
    return table[where.reshape(ids.shape)]


def _heat(level: F32) -> F32:
    at = np.clip(level, 0, 1) * (len(_HEAT) - 1)
    return np.stack([np.interp(at, np.arange(len(_HEAT)), _HEAT[:, i]) for i in range(3)], axis=-1).astype(np.float32)
