"""Converts between an image's stored pixels and linear values."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.description import Image

__all__ = ["alpha", "encoded", "integer_codes", "linear", "white_value", "with_equal_depth"]

F32 = npt.NDArray[np.float32]
Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def linear(image: Image) -> F32:
    """Returns (h, w, 3) scene-linear pixels of an image."""
    pixels = np.asarray(image.pixels[..., :3], np.float32)
    if image.pixels.dtype == np.float32:
        return pixels
    pixels /= np.float32(white_value(image.pixels))
    return np.asarray(decode_srgb(pixels) if image.srgb else pixels, np.float32)


def alpha(image: Image) -> F32:
    """Returns (h, w) alpha values, 0..1, of an image; 1 if it has no alpha channel."""
    if image.pixels.shape[2] < 4:
        return np.ones(image.pixels.shape[:2], np.float32)
    return np.asarray(np.clip(image.pixels[..., 3] / np.float32(white_value(image.pixels)), 0, 1), np.float32)


def white_value(pixels: npt.NDArray[Any]) -> float:
    """Returns the stored pixel value that means 1.0: the type's maximum for integers, 1 for floats."""
    return float(np.iinfo(pixels.dtype).max) if np.issubdtype(pixels.dtype, np.integer) else 1.0


def integer_codes(image: Image) -> Codes:
    """Returns an image's RGBA as 8-bit or 16-bit integers.

    Integer pixels are returned as stored; float pixels as linear values clamped to 0..1, in 16 bits.
    """
    if image.pixels.dtype != np.float32:
        found: Codes = image.pixels
        return found
    return encoded(np.dstack([image.pixels[..., :3], alpha(image)]), image)


def encoded(values: npt.NDArray[np.floating], *sources: Image, srgb: bool = False) -> Codes:
    """Returns values, clamped to 0..1, as integers: 16-bit if any image in `sources` has more than 8 bits, otherwise 8-bit.

    srgb: whether to sRGB-encode the first three channels.
    """
    values = np.clip(values, 0, 1)
    if srgb:
        values = np.concatenate([encode_srgb(values[..., :3]), values[..., 3:]], axis=-1)
    if all(source.pixels.dtype == np.uint8 for source in sources):
        return np.rint(values * 255).astype(np.uint8)
    return np.rint(values * 65535).astype(np.uint16)


def with_equal_depth(first: Codes, second: Codes) -> tuple[Codes, Codes]:
    """Returns two arrays of 8-bit or 16-bit codes; if their depths differ, the 8-bit one is converted to 16 bits."""
    if first.dtype == second.dtype:
        return first, second
    a, b = (each if each.dtype == np.uint16 else each.astype(np.uint16) * np.uint16(257) for each in (first, second))
    return a, b
