"""`python -m service.intake.read_reference IMAGE NAME FILM`: converts an uploaded image to a film that the page can read.

It runs in a process of its own, with limits, so no image can end the service. It prints one line of JSON: the result, or an
`error`.
"""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path

import numpy as np

from renderer.errors import SceneError
from renderer.image import rgbe9995
from renderer.image.read import read
from service.watching.film_packet import packed_picture

__all__ = ["MEMORY", "as_film"]

MEMORY = 4 << 30  # bytes, beside what the process has before it reads
ROWS = 64


def as_film(image: Path, name: str, film: Path) -> dict[str, object]:
    """Write the film; its size, whether it is display-referred, and how many pixels are changed. Raises SceneError."""
    pixels = read(image.read_bytes(), name)
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)  # as screens show it
    height, width = pixels.shape[:2]
    if max(width, height) > 0xFFFF:
        raise SceneError(f"{name}: is {width}x{height}; a side has at most 65535 pixels")
    is_display = pixels.dtype == np.uint8
    words = np.empty((height, width), np.uint32)
    clipped = 0
    for y in range(0, height, ROWS):
        rows = pixels[y : y + ROWS, :, :3]
        light = from_srgb(rows) if is_display else rows
        clipped += int(np.any((light < 0) | (light > rgbe9995.MAX), axis=2).sum())
        words[y : y + ROWS] = rgbe9995.pack(light)
    with film.open("wb") as file:
        for piece in packed_picture(words):
            file.write(piece)
    return {"width": width, "height": height, "is_display": is_display, "clipped": clipped}


def from_srgb(codes: np.ndarray) -> np.ndarray:
    """sRGB codes 0..255 as linear light 0..1, float32 (IEC 61966-2-1)."""
    value = np.arange(256) / 255
    table = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.asarray(table.astype(np.float32)[codes])


def main() -> None:
    """See the module."""
    image, name, film = sys.argv[1:]
    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (has + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        answer = as_film(Path(image), name, Path(film))
    except SceneError as error:
        answer = {"error": str(error)}
    except MemoryError:
        answer = {"error": f"{name}: needs more than the {MEMORY >> 30} GiB that reading an image may take. Make it smaller."}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
