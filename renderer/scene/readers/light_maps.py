"""Converts images and IES profiles to emission maps, which scale a light's emission by direction."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import F32, EmissionKind, EmissionMap
from renderer.scene.files import SceneFiles
from renderer.scene.readers.ies import Photometry, read_ies

__all__ = ["LUMENS_PER_WATT", "all_around", "photometry_of", "projected_map"]

LUMENS_PER_WATT = 683.0  # at 555 nm; Blender's glTF importer uses the same factor
_MOST_SIDE = 2048


def photometry_of(files: SceneFiles, name: str) -> Photometry:
    """Returns the IES profile in a file of the scene, cached. Raises SceneError if the file is missing or invalid."""
    return files.get_or_make(("IES", name), lambda: read_ies(files.read(name), name))


def projected_map(pixels: F32, half_width: float, half_height: float, kind: EmissionKind = "window") -> EmissionMap:
    """Returns the emission map of an (h, w, 3) image that a light projects along its axis, upright as seen from the light.

    half_width, half_height: half the projected image's width and height at distance 1 from the light.
    """
    return EmissionMap(kind, _valid_pixels(pixels), (-half_width, half_width, half_height, -half_height))


def all_around(pixels: F32) -> EmissionMap:
    """Returns the emission map of an (h, w, 3) equirectangular image, as seen from the light.

    The axis points to the image's top row, and the image's centre is opposite to `up`. For a light with axis Y and `up` Z, the
    centre is at -Z, as in environment images.
    """
    return EmissionMap("sphere", _valid_pixels(pixels), (-1.5 * math.pi, 0.5 * math.pi, 0.0, math.pi))


def _valid_pixels(pixels: F32) -> F32:
    """Returns an image's RGB pixels with negative and non-finite values set to 0.

    An image larger than the limit is halved in size until it is within the limit.
    """
    pixels = np.nan_to_num(np.maximum(pixels[..., :3], 0.0), nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
    while max(pixels.shape[:2]) > _MOST_SIDE:
        height, width = (n - n % 2 for n in pixels.shape[:2])
        if min(height, width) == 0:
            break
        pixels = pixels[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    return pixels
