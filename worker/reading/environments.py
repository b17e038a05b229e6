"""Renders the thumbnail of an environment image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from renderer.confine.reader import Link
from renderer.errors import SceneError
from renderer.image import encode
from renderer.image.read import decode
from renderer.sentences import Sentence
from worker.reading.scene_folder import folder_of

__all__ = ["small_picture", "write_thumbnail"]

NARROWEST, WIDEST = 1.9, 2.1  # an equirectangular image is twice as wide as high


def write_thumbnail(folder: bytes, name: str, width: int, result: bytes, link: Link) -> dict[str, Any]:
    """Writes the thumbnail of the image `name` in `folder` to the JPEG file `result`. Raises SceneError.

    width: in pixels.
    """
    folder_of(result).write_bytes(encode.encode(small_picture(_pixels(folder_of(folder), name), width), "jpg"))
    return {}


def _pixels(folder: Path, path: str) -> np.ndarray:
    pixels = decode((folder / path).read_bytes(), path, is_environment=True).pixels
    height, width = pixels.shape[:2]
    if not NARROWEST < width / height < WIDEST:
        raise SceneError(
            Sentence(
                "environment-not-equirectangular",
                "{path}: is {width}x{height}; an environment must be equirectangular (latitude-longitude), twice as wide as high",
                path=path,
                width=width,
                height=height,
            )
        )
    if pixels.dtype != np.float32:
        pixels = (pixels[..., :3].astype(np.float32) / np.iinfo(pixels.dtype).max) ** 2.2
    if not np.isfinite(pixels[..., :3]).any() or not pixels[..., :3].any():
        raise SceneError(
            Sentence("environment-black", "{path}: is completely black and gives no light; give another image", path=path)
        )
    return np.asarray(pixels[..., :3])


def small_picture(pixels: np.ndarray, width: int) -> np.ndarray:
    """Returns the radiance (h, w, 3) of an environment reduced to (width / 2, width, 3) by averaging blocks.

    The result is scaled to a mean brightness of 0.6; the brightest pixels count with limited weight, so that lamps do not
    darken the rest.
    """
    height = width // 2
    rows = np.linspace(0, len(pixels), height + 1).astype(int)
    columns = np.linspace(0, pixels.shape[1], width + 1).astype(int)
    clean = np.clip(np.nan_to_num(pixels, nan=0.0, posinf=1e4, neginf=0.0), 0, 1e4).astype(np.float64)
    if min(clean.shape[:2]) < height or clean.shape[1] < width:  # smaller than the thumbnail: nearest pixels
        small = clean[np.minimum(rows[:-1], len(clean) - 1)][:, np.minimum(columns[:-1], clean.shape[1] - 1)]
    else:
        summed = np.add.reduceat(np.add.reduceat(clean, rows[:-1], axis=0), columns[:-1], axis=1)
        small = summed / (np.diff(rows)[:, None, None] * np.diff(columns)[None, :, None])
    grey = small.mean(axis=2)
    level = float(np.minimum(grey, np.quantile(grey, 0.95)).mean())  # clipped, so that a sun or a lamp does not darken the rest
    return (small * (0.6 / max(level, 1e-6))).astype(np.float32)
