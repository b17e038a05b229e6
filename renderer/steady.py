"""Denoised frames of a shot made steady: each is averaged with its neighbours along the motion vectors.

A denoiser that sees one frame at a time guesses anew at each, and what it guesses flickers. Where the same thing is seen in
neighbouring frames, their guesses are several of one quantity. As in SVGF (Schied et al. 2017) and its kin, a neighbour counts as
far as it shows the same thing: the same object and material, a normal that agrees, a vector that leads back, and light that
is much the same, so that the edge of a moving shadow stays where it is. Light is averaged without the surface's own colour, which
would blur with every shift by part of a pixel. Both directions of time: a frame that is finished knows its successors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.denoise import Clean

__all__ = ["REACH", "Still", "steadied"]

F32 = npt.NDArray[np.float32]

REACH = 2  # frames before and after
_LEAST_COSINE = 0.9
_ASTRAY = 0.5  # pixels that a vector and the one back may lack of meeting
_ALIKE = 0.25  # light that differs by this share counts exp(-1)
_DARK = 0.02  # the least albedo to divide by
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class Still(NamedTuple):
    """A denoised frame by itself, and what tells what it shows."""

    clean: Clean
    object: F32  # (h, w), renderer.aovs
    material: F32  # (h, w)
    motion: F32  # (h, w, 4), renderer.vectors


def steadied(frames: Mapping[int, Still], number: int) -> F32:
    """The frame of that number, averaged with those of its neighbours that there are, at most REACH away: (h, w, 3) float32.

    frames: by their numbers; a neighbour counts if all between it and the frame are there. The answer depends on these alone.
    """
    here = frames[number]
    surface = np.maximum(here.clean.albedo, _DARK)
    light = (here.clean.color / surface).astype(np.float64)
    total, weight = light.copy(), np.ones(light.shape[:2])
    for way in (-1, 1):
        rows, columns = np.mgrid[0 : light.shape[0], 0 : light.shape[1]].astype(np.float64)
        alive = np.ones(light.shape[:2], bool)
        for step in range(1, REACH + 1):
            there, before = frames.get(number + way * step), frames[number + way * (step - 1)]
            if there is None:
                break
            shift = _fetched(before.motion, rows, columns)
            rows, columns, alive = _shifted(shift, rows, columns, way, alive)
            back = _fetched(there.motion, rows, columns)
            alive = alive & _leads_back(shift, back, way)
            found, share = _seen(here, there, rows, columns, alive)
            share = share * _alike(light, found)
            total += share[..., None] * found
            weight += share
    return (total / weight[..., None] * surface).astype(np.float32)


def _shifted(
    shift: F32, rows: npt.NDArray[np.float64], columns: npt.NDArray[np.float64], way: int, alive: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Where pixels are a frame before (way -1) or after, and which of them are still in the picture."""
    x, y = (shift[..., 0], shift[..., 1]) if way < 0 else (-shift[..., 2], -shift[..., 3])
    columns, rows = columns + x, rows - y
    height, width = rows.shape
    alive = alive & (rows > -0.5) & (rows < height - 0.5) & (columns > -0.5) & (columns < width - 0.5)
    return np.where(alive, rows, 0.0), np.where(alive, columns, 0.0), alive


def _leads_back(shift: F32, back: F32, way: int) -> npt.NDArray[np.bool_]:
    """Whether the vector that was followed and the other frame's, back again, are the same: else something stood before it."""
    gone, come = (shift[..., :2], back[..., 2:]) if way < 0 else (shift[..., 2:], back[..., :2])
    apart: npt.NDArray[np.bool_] = np.abs(gone - come).max(axis=-1) < _ASTRAY
    return apart


def _nearest(plane: F32, rows: npt.NDArray[np.float64], columns: npt.NDArray[np.float64]) -> F32:
    found: F32 = plane[np.rint(rows).astype(np.intp), np.rint(columns).astype(np.intp)]
    return found


_fetched = _nearest


def _seen(
    here: Still,
    there: Still,
    rows: npt.NDArray[np.float64],
    columns: npt.NDArray[np.float64],
    alive: npt.NDArray[np.bool_],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The other frame's light between four pixels, those alone that show the same thing; and their share, 0 ... 1."""
    height, width = alive.shape
    light = there.clean.color / np.maximum(there.clean.albedo, _DARK)
    top, left = np.floor(rows).astype(np.intp), np.floor(columns).astype(np.intp)
    down, right = rows - top, columns - left
    total, weight = np.zeros((height, width, 3)), np.zeros((height, width))
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        y, x = np.clip(top + i, 0, height - 1), np.clip(left + j, 0, width - 1)
        share = (down if i else 1 - down) * (right if j else 1 - right)
        same = alive & (there.object[y, x] == here.object) & (there.material[y, x] == here.material)
        cosine = (there.clean.normal[y, x] * here.clean.normal).sum(axis=-1)
        lengths = np.sqrt((there.clean.normal[y, x] ** 2).sum(axis=-1) * (here.clean.normal**2).sum(axis=-1))
        same &= cosine >= _LEAST_COSINE * lengths
        share = np.where(same, share, 0.0)
        total += share[..., None] * light[y, x]
        weight += share
    return total / np.maximum(weight, 1e-9)[..., None], weight


def _alike(light: npt.NDArray[np.float64], found: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How far two lights are much the same, 0 ... 1."""
    a, b = light @ _LUMINANCE, found @ _LUMINANCE
    apart = (a - b) / np.maximum(0.5 * (a + b), 1e-6)
    alike: npt.NDArray[np.float64] = np.exp(-((apart / _ALIKE) ** 2))
    return alike
