"""Pictures and IES profiles as what a light sends into each direction."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import F32, EmissionKind, EmissionMap
from renderer.scene.files import SceneFiles
from renderer.scene.readers.ies import Photometry, read_ies

__all__ = ["LUMENS_PER_WATT", "all_around", "photometry_of", "thrown"]

LUMENS_PER_WATT = 683.0  # at 555 nm; with it a candela becomes the radiant intensity that Blender's importer of glTF takes, too
_MOST_SIDE = 2048


def photometry_of(files: SceneFiles, name: str) -> Photometry:
    """The profile in a file of the scene, read once. Raises SceneError."""
    return files.recall(("IES", name), lambda: read_ies(files.read(name), name))


def thrown(pixels: F32, half_width: float, half_height: float, kind: EmissionKind = "window") -> EmissionMap:
    """A (h, w, 3) picture that is thrown along the axis, upright as seen from the light: so wide and high at the distance 1."""
    return EmissionMap(kind, _sane(pixels), (-half_width, half_width, half_height, -half_height))


def all_around(pixels: F32) -> EmissionMap:
    """A (h, w, 3) equirectangular picture as seen from the light: the axis leads to its top row, its middle is below `up`.

    So of a light whose axis is Y and whose `up` is Z, the middle looks along -Z, as an environment's does.
    """
    return EmissionMap("sphere", _sane(pixels), (-1.5 * math.pi, 0.5 * math.pi, 0.0, math.pi))


def _sane(pixels: F32) -> F32:
    """Without what no light is, and not larger than is of use."""
    pixels = np.nan_to_num(np.maximum(pixels[..., :3], 0.0), nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
    while max(pixels.shape[:2]) > _MOST_SIDE:
        height, width = (n - n % 2 for n in pixels.shape[:2])
        if min(height, width) == 0:
            break
        pixels = pixels[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    return pixels
