"""Converts an uploaded image to a film packet that the page can read. Runs in a confined process (renderer/confine/)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from renderer.confine.reader import Link
from renderer.errors import SceneError
from renderer.image import rgbe9995
from renderer.sentences import Sentence
from service.watching.film_packet import picture_packet

__all__ = ["as_film"]

ROWS = 64


def as_film(image: bytes, name: str, film: bytes, link: Link) -> dict[str, object]:
    """Writes an uploaded image as a film packet; returns its width, height, is_display and number of clipped pixels.

    image, film: paths encoded by os.fsencode. is_display: whether the image is display-encoded (8 or 16 bits). Raises
    SceneError if the image cannot be read or is too large.
    """
    from renderer.image.read import read  # only in the confined process: the service does not need OpenImageIO to start

    pixels = read(Path(os.fsdecode(image)).read_bytes(), name)
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)  # reduced to 8 bits, as displayed
    height, width = pixels.shape[:2]
    if max(width, height) > 0xFFFF:
        raise SceneError(
            Sentence(
                "reference-image-too-wide",
                "{name}: is {width}x{height}; a side may have at most 65535 pixels. Make it smaller.",
                name=name,
                width=width,
                height=height,
            )
        )
    is_display = pixels.dtype == np.uint8
    words = np.empty((height, width), np.uint32)
    clipped = 0
    for y in range(0, height, ROWS):
        rows = pixels[y : y + ROWS, :, :3]
        light = from_srgb(rows) if is_display else rows
        clipped += int(np.any((light < 0) | (light > rgbe9995.MAX), axis=2).sum())
        words[y : y + ROWS] = rgbe9995.pack(light)
    with Path(os.fsdecode(film)).open("wb") as file:
        for piece in picture_packet(words):
            file.write(piece)
    return {"width": width, "height": height, "is_display": is_display, "clipped": clipped}


def from_srgb(codes: np.ndarray) -> np.ndarray:
    """Converts sRGB codes 0..255 to linear values 0..1, float32 (IEC 61966-2-1)."""
    value = np.arange(256) / 255
    table = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.asarray(table.astype(np.float32)[codes])
