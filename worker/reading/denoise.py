"""Denoises a frame with Open Image Denoise. Its threads and memory are freed when the process ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer import denoise as library
from renderer import temporal_denoise
from renderer.confine.reader import Link
from renderer.frames import frame_number
from worker.reading.scene_folder import folder_of

__all__ = ["denoise", "denoise_in_shot", "denoise_lights"]


def denoise(
    means: bytes,
    result: bytes,
    width: int,
    height: int,
    link: Link,
    *,
    is_preview: bool = False,
    has_clean_guides: bool = False,
    is_rough: bool = False,
    threads: int | None = None,
) -> dict[str, Any]:
    """Writes the denoised colour as float32 to the file `result`. Returns an empty answer.

    means: path of the file with the frame's mean colour, albedo and normal, float32, each (height, width, 3). is_preview: in a
    third of the time or less, with edges that are less sharp. has_clean_guides: of a preview, whether its albedo and normal are
    taken as free of noise. is_rough: of a preview, whether it takes half of the time, with a larger error. threads: None for all
    cores.
    """
    color, albedo, normal = np.fromfile(folder_of(means), "<f4").reshape(3, height, width, 3)
    if is_preview:
        options = {"has_clean_guides": has_clean_guides, "is_rough": is_rough}
        picture = library.denoise_fast(color, albedo, normal, threads, **options)
    else:
        picture = library.denoise(color, albedo, normal, threads)
    picture.astype("<f4").tofile(folder_of(result))
    return {}


def denoise_lights(
    means: bytes,
    result: bytes,
    count: int,
    width: int,
    height: int,
    link: Link,
    *,
    has_clean_guides: bool = False,
    threads: int | None = None,
) -> dict[str, Any]:
    """Writes the denoised light of light groups as float32, shape (height, count, width, 3), to the file `result`.

    Returns an empty answer. means: path of the file with the mean light of each group, the albedo and the normal, float32, each
    (height, width, 3). count: of the groups. has_clean_guides: see `denoise`. threads: None for all cores.
    """
    *lights, albedo, normal = np.fromfile(folder_of(means), "<f4").reshape(count + 2, height, width, 3)
    clean = [library.denoise_fast(light, albedo, normal, threads, has_clean_guides=has_clean_guides) for light in lights]
    np.stack(clean, axis=1).astype("<f4", copy=False).tofile(folder_of(result))
    return {}


def denoise_in_shot(
    folder: bytes, result: bytes, frames: list[int], frame: int, width: int, height: int, link: Link
) -> dict[str, Any]:
    """Writes a denoised frame of a shot, averaged with its neighbours, as float32 to the file `result`. Returns an empty answer.

    frames: keys of the frame and its neighbours, in order. folder: of the files N.means, with the object and material planes
    behind the means, and N.motion, with the motion vectors, for each index N in `frames`.
    """
    place = folder_of(folder)
    known = {}
    for index, key in enumerate(frames):
        planes = np.fromfile(place / f"{index}.means", "<f4")
        means, ids = np.split(planes, [9 * height * width])
        color, albedo, normal = means.reshape(3, height, width, 3)
        number, material = ids.reshape(2, height, width)
        motion = np.fromfile(place / f"{index}.motion", "<f4").reshape(height, width, 4)
        clean = library.denoise_with_guides(color, albedo, normal)
        known[frame_number(key)] = temporal_denoise.DenoisedFrame(clean, number, material, motion)
    temporal_denoise.stabilised_frame(known, frame_number(frame)).astype("<f4").tofile(folder_of(result))
    return {}
