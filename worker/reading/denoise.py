"""Denoises a frame with Open Image Denoise. Its threads and memory are freed when the process ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer import denoise as library
from renderer.confine.reader import Link
from worker.reading.scene_folder import folder_of

__all__ = ["denoise"]


def denoise(means: bytes, result: bytes, width: int, height: int, link: Link, *, is_preview: bool = False) -> dict[str, Any]:
    """Writes the denoised colour as float32 to the file `result`. Returns an empty answer.

    means: path of the file with the frame's mean colour, albedo and normal, float32, each (height, width, 3). is_preview: in a
    third of the time, with edges that are less sharp.
    """
    color, albedo, normal = np.fromfile(folder_of(means), "<f4").reshape(3, height, width, 3)
    clean = library.denoise_fast if is_preview else library.denoise
    clean(color, albedo, normal).astype("<f4").tofile(folder_of(result))
    return {}
