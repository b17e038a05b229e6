"""Exports Blender's images as files: unchanged if the farm reads their format, else converted."""

from __future__ import annotations

import hashlib
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..farm import exr
from .model import Image, Scene

__all__ = ["Pixels", "add_pixels", "encoded", "encoding_of", "lights_with", "pixels", "png", "register"]

F32 = npt.NDArray[np.float32]
AS_THEY_ARE = {"PNG": ".png", "JPEG": ".jpg", "WEBP": ".webp"}
Pixels = F32


def register(scene: Scene, image: Any, as_color: bool, deep: bool = False) -> str | None:
    """Adds an image to the exported scene and returns its file name; None, with a warning, if the image has no pixels.

    image: a bpy.types.Image or a Painted. as_color: True: the values are colours, stored in sRGB; False: data, stored unchanged.
    deep: whether a converted image has 16 bits per channel, not 8.
    """
    if image.source == "PAINTED":
        return add_pixels(scene, image.name, image.texels, encoding_of(image, as_color), deep)
    if image.source == "TILED":
        scene.warn(f"Image {image.name}: of its tiles (UDIM) the first is taken.")
    if image.source in ("MOVIE", "SEQUENCE"):
        scene.warn(f"Image {image.name}: films and sequences are taken as they are at this frame.")
    fits = _is_srgb(image) == as_color or (image.is_float and not as_color)
    content = _content(image) if fits and not image.is_dirty and image.source == "FILE" else None
    if content is not None:
        suffix = AS_THEY_ARE[image.file_format]
        return _add_image(scene, image.name, suffix, content)
    found = pixels(image)
    if found is None:
        scene.warn(f"Image {image.name}: it has no pixels; is its file there?")
        return None
    return add_pixels(scene, image.name, found, encoding_of(image, as_color), deep)


def add_pixels(scene: Scene, name: str, found: Pixels, encoding: str = "", deep: bool = False) -> str:
    """Adds an image (h, w, 4), rows from the top, to the exported scene as a PNG file; returns its file name.

    encoding: conversion of the pixels before they are stored, as in `encoded`. deep: 16 bits per channel, not 8.
    """
    if encoding:
        found = found.copy()
        found[..., :3] = encoded(found[..., :3], encoding)
    if deep:
        return _add_image(scene, f"{name} 16", ".png", png((np.clip(found, 0, 1) * 65535 + 0.5).astype(np.uint16)))
    return _add_image(scene, name, ".png", png((np.clip(found, 0, 1) * 255 + 0.5).astype(np.uint8)))


def encoded(values: F32, encoding: str) -> F32:
    """Returns the values converted to sRGB ("to") or from sRGB ("from"), clamped to 0 ... 1; unchanged if encoding is ""."""
    if not encoding:
        return values
    cut = np.clip(values, 0, 1)
    return to_srgb(cut) if encoding == "to" else from_srgb(cut)


def to_srgb(linear: F32) -> F32:
    """Returns linear values encoded in sRGB (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055).astype(np.float32)


def from_srgb(encoded: F32) -> F32:
    """Returns sRGB values decoded to linear."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def encoding_of(image: Any, as_color: bool) -> str:
    """Returns the conversion that an image's pixels need, for `encoded`: "to", "from" or "".

    as_color: True if the pixels are to be stored as sRGB colours.
    """
    if image.is_float:  # pixels are linear
        return "to" if as_color else ""
    if _is_srgb(image) == as_color:
        return ""
    return "to" if as_color else "from"


def _is_srgb(image: Any) -> bool:
    return image.colorspace_settings.name.lower().startswith(("srgb", "filmic srgb", "agx"))


def _content(image: Any) -> bytes | Path | None:
    if image.file_format not in AS_THEY_ARE:
        return None
    if image.packed_file is not None:
        return bytes(image.packed_file.data)
    path = Path(image.filepath_from_user())
    return path if path.is_file() else None


def pixels(image: Any) -> Pixels | None:
    """Returns an image's pixels, (h, w, 4) float32, in the encoding that Blender stores, rows from the top.

    Returns None if the image has none.
    """
    if image.source == "PAINTED":
        return image.texels
    width, height = image.size
    if not width or not height or not image.channels:
        return None
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    found = np.ones((height, width, 4), np.float32)
    given = flat.reshape(height, width, image.channels)[::-1]
    found[..., : image.channels] = given
    if image.channels < 3:
        found[..., :3] = given[..., :1]
    return found


def _add_image(scene: Scene, name: str, suffix: str, content: bytes | Path) -> str:
    stem = "".join(c if c.isalnum() else "-" for c in Path(name).stem)[:40] or "image"
    told = hashlib.sha256(name.encode()).hexdigest()[:8]
    found = f"textures/{stem}-{told}{suffix}"
    scene.images[found] = Image(found, content)
    return found


def png(values: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """Encodes an (h, w, 3 or 4) uint8 or uint16 array as a PNG file."""
    height, width, channels = values.shape
    size = values.dtype.itemsize
    rows = np.zeros((height, 1 + width * channels * size), np.uint8)  # the first byte of each row is its filter: 0, none
    rows[:, 1:] = np.ascontiguousarray(values, values.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    head = struct.pack(">IIBBBBB", width, height, 8 * size, {3: 2, 4: 6}[channels], 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 3)), (b"IEND", b"")]
    chunks = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def lights_with(image: Any) -> Image | None:
    """Returns the image of a world as an environment image file; None if the image has no pixels."""
    if image.source == "FILE" and not image.is_dirty and image.file_format in ("HDR", "OPEN_EXR"):
        suffix = ".hdr" if image.file_format == "HDR" else ".exr"
        path = Path(image.filepath_from_user())
        if image.packed_file is not None:
            return Image(f"world{suffix}", bytes(image.packed_file.data))
        if path.is_file():
            return Image(f"world{suffix}", path)
    found = pixels(image)
    if found is None:
        return None
    linear = found[..., :3] if image.is_float or not _is_srgb(image) else from_srgb(found[..., :3])
    return Image("world.exr", exr.write(linear))
