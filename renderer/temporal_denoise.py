"""Stabilises denoised frames over time: each is averaged with its neighbours along the motion vectors.

A denoiser that sees one frame at a time estimates each anew, so its estimates flicker. Where neighbouring frames show the same
surface point, there are several estimates of one value. As in SVGF (Schied et al. 2017), a neighbour is weighted by whether it
shows the same point: equal object and material, similar normal, a motion vector that leads back, and similar light, so that the
edge of a moving shadow is preserved. Light is averaged without the surface's albedo, which would blur with every subpixel shift;
the albedo is averaged only where nothing moves. Both directions of time are used, since the frames of a finished shot also have
successors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.denoise import DenoisedPicture
from renderer.frames import DENOISED_REACH
from renderer.luminance import REC_709

__all__ = ["DenoisedFrame", "stabilised_frame"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_LEAST_COSINE = 0.9
_MOTION_TOLERANCE = 0.5  # pixels: tolerance between a motion vector and the reverse one
_LIGHT_TOLERANCE = 0.12  # relative difference of light with weight exp(-1)
_SHIFT_TOLERANCE = 0.05  # pixels: tolerance of a whole-pixel shift
_MIN_ALBEDO = 0.02  # minimum divisor for albedo


class DenoisedFrame(NamedTuple):
    """A denoised frame with its guides: albedo, normal, object, material and motion vectors."""

    clean: DenoisedPicture
    object: F32  # (h, w), renderer.aovs
    material: F32  # (h, w)
    motion: F32  # (h, w, 4), renderer.vectors


class _PixelPositions(NamedTuple):
    """The positions of a frame's pixels in a neighbouring frame: rows, columns, and which of these are valid (`alive`)."""

    rows: F64
    columns: F64
    alive: Mask


def stabilised_frame(frames: Mapping[float, DenoisedFrame], number: float) -> F32:
    """Returns a frame averaged with its available neighbours, at most DENOISED_REACH frames away: (h, w, 3) float32.

    frames: frame number -> frame; a neighbour is used only if all frames in between are available. number: of the frame. The
    result depends on these arguments only.
    """
    here = frames[number]
    light, surface = _light(here), _surface(here)
    total, weight = light.copy(), np.ones(light.shape[:2])
    colors, times = surface.copy(), np.ones(light.shape[:2])
    for way in (-1, 1):
        rows, columns = np.mgrid[0 : light.shape[0], 0 : light.shape[1]].astype(np.float64)
        places = _PixelPositions(rows, columns, np.ones(light.shape[:2], bool))
        for step in range(1, DENOISED_REACH + 1):
            there = frames.get(number + way * step)
            if there is None:
                break
            places = _step_along_motion(frames[number + way * (step - 1)], there, places, way)
            found, share = _interpolated_light(here, there, places)
            share = share * _light_similarity(light, found)
            total += share[..., None] * found
            weight += share
            share = np.where(_is_whole_pixel(places.rows) & _is_whole_pixel(places.columns), share, 0.0)
            colors += share[..., None] * _nearest(_surface(there), places)
            times += share
    return (total / weight[..., None] * (colors / times[..., None])).astype(np.float32)


def _surface(still: DenoisedFrame) -> F64:
    return np.maximum(still.clean.albedo, _MIN_ALBEDO).astype(np.float64)


def _light(still: DenoisedFrame) -> F64:
    return still.clean.color / _surface(still)


def _is_whole_pixel(place: F64) -> Mask:
    near: Mask = np.abs(place - np.rint(place)) < _SHIFT_TOLERANCE
    return near


def _nearest(plane: npt.NDArray[np.floating], places: _PixelPositions) -> npt.NDArray[np.floating]:
    found: npt.NDArray[np.floating] = plane[np.rint(places.rows).astype(np.intp), np.rint(places.columns).astype(np.intp)]
    return found


def _step_along_motion(
    before: DenoisedFrame, other_frame: DenoisedFrame, places: _PixelPositions, direction: int
) -> _PixelPositions:
    """Returns the pixels' positions one frame further along their motion. direction: -1 towards earlier frames, 1 towards later
    ones.

    before, other_frame: the frames of the old and new positions. A position becomes invalid where the vector back to the old
    frame differs (occlusion).
    """
    shift = _nearest(before.motion, places)
    x, y = (shift[..., 0], shift[..., 1]) if direction < 0 else (-shift[..., 2], -shift[..., 3])
    rows, columns = places.rows - y, places.columns + x
    height, width = rows.shape
    alive = places.alive & (rows > -0.5) & (rows < height - 0.5) & (columns > -0.5) & (columns < width - 0.5)
    found = _PixelPositions(np.where(alive, rows, 0.0), np.where(alive, columns, 0.0), alive)
    back = _nearest(other_frame.motion, found)
    gone, come = (shift[..., :2], back[..., 2:]) if direction < 0 else (shift[..., 2:], back[..., :2])
    return found._replace(alive=alive & (np.abs(gone - come).max(axis=-1) < _MOTION_TOLERANCE))


def _interpolated_light(frame: DenoisedFrame, other_frame: DenoisedFrame, places: _PixelPositions) -> tuple[F64, F64]:
    """Returns (the light of `other_frame` at the given positions, the total weight, 0 to 1, of the pixels used).

    The light is interpolated between those of the four nearest pixels that show the same surface.
    """
    height, width = places.rows.shape
    light, normal = _light(other_frame), frame.clean.normal
    top, left = np.floor(places.rows).astype(np.intp), np.floor(places.columns).astype(np.intp)
    down, right = places.rows - top, places.columns - left
    total, weight = np.zeros((height, width, 3)), np.zeros((height, width))
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        y, x = np.clip(top + i, 0, height - 1), np.clip(left + j, 0, width - 1)
        same = places.alive & (other_frame.object[y, x] == frame.object) & (other_frame.material[y, x] == frame.material)
        other = other_frame.clean.normal[y, x]
        lengths = np.sqrt((other**2).sum(axis=-1) * (normal**2).sum(axis=-1))
        same &= (other * normal).sum(axis=-1) >= _LEAST_COSINE * lengths
        share = np.where(same, (down if i else 1 - down) * (right if j else 1 - right), 0.0)
        total += share[..., None] * light[y, x]
        weight += share
    return total / np.maximum(weight, 1e-9)[..., None], weight


def _light_similarity(light: F64, found: F64) -> F64:
    """Returns the similarity of the luminances of two light values: 1 if equal, towards 0 as their relative difference grows."""
    a, b = ((each * REC_709).sum(axis=-1) for each in (light, found))
    apart = (a - b) / np.maximum(0.5 * (a + b), 1e-6)
    alike: F64 = np.exp(-((apart / _LIGHT_TOLERANCE) ** 2))
    return alike
