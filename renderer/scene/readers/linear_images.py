"""An image's pixels as light and as numbers, whatever they are stored in."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.description import Image

__all__ = ["alike", "alpha", "codes", "encoded", "linear", "most"]

F32 = npt.NDArray[np.float32]
Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def linear(image: Image) -> F32:
    """An image's scene-linear pixels, (h, w, 3)."""
    pixels = np.asarray(image.pixels[..., :3], np.float32)
    if image.pixels.dtype == np.float32:
        return pixels
    pixels /= np.float32(most(image.pixels))
    return np.asarray(decode_srgb(pixels) if image.srgb else pixels, np.float32)


def alpha(image: Image) -> F32:
    """An image's alpha, (h, w), 0 ... 1; 1 where it has none."""
    if image.pixels.shape[2] < 4:
        return np.ones(image.pixels.shape[:2], np.float32)
    return np.asarray(np.clip(image.pixels[..., 3] / np.float32(most(image.pixels)), 0, 1), np.float32)


def most(pixels: npt.NDArray[Any]) -> float:
    """The value of pixels that means 1."""
    return float(np.iinfo(pixels.dtype).max) if np.issubdtype(pixels.dtype, np.integer) else 1.0


def codes(image: Image) -> Codes:
    """An image's RGBA as codes of 8 bits where it has these, else of 16; of floats what is linear, from 0 to 1."""
    if image.pixels.dtype != np.float32:
        found: Codes = image.pixels
        return found
    return encoded(np.dstack([image.pixels[..., :3], alpha(image)]), image)


def encoded(values: npt.NDArray[np.floating], *sources: Image, srgb: bool = False) -> Codes:
    """Values 0 ... 1 as codes of 8 bits, or of 16 where one of the images that they come from has more than 8.

    srgb: encodes the first three channels.
    """
    values = np.clip(values, 0, 1)
    if srgb:
        values = np.concatenate([encode_srgb(values[..., :3]), values[..., 3:]], axis=-1)
    if all(source.pixels.dtype == np.uint8 for source in sources):
        return np.rint(values * 255).astype(np.uint8)
    return np.rint(values * 65535).astype(np.uint16)


def alike(first: Codes, second: Codes) -> tuple[Codes, Codes]:
    """Two arrays of codes with as many bits each."""
    if first.dtype == second.dtype:
        return first, second
    a, b = (each if each.dtype == np.uint16 else each.astype(np.uint16) * np.uint16(257) for each in (first, second))
    return a, b
