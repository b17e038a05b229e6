"""A view's picture in the making: exact sums of colour in memory, its noise, and which tiles have to be shown again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer import film
from renderer.film import CHANNELS, COLOR, COLOR_HALF, SAMPLES, SAMPLES_HALF, Sums
from service.scheduling.jobs.active_frame import FIRST_LOOK
from service.scheduling.jobs.plan import FIRST_CHECK
from service.viewing.passes import Level

__all__ = ["BYTES_A_PIXEL", "GROWTH", "Canvas"]

BYTES_A_PIXEL = 52  # of memory
GROWTH = 1.5  # times the samples that a tile was shown with, it is shown again: less is hardly seen


class Canvas:
    """The sums of one level. Each piece is to be added once, in any order.

    noise: relative, as of jobs: a tile is complete that has come to it, at 32, 64, 128 ... samples; None: with all its samples.
    """

    def __init__(self, level: Level, film_exponent: int, noise: float | None = None) -> None:
        self.level = level
        self.film_exponent = film_exponent
        self.changed: dict[int, None] = {}  # tiles to be shown anew, in the order in which they came to it
        self._wanted = noise
        self._areas = np.array([tile.w * tile.h for tile in level.tiles], np.int64)
        self._counts = np.zeros(len(level.tiles), np.int64)  # samples of each tile's pixels
        self._ended = np.zeros(len(level.tiles), bool)  # whether it has come to the noise that is wanted
        self._shown = np.zeros(len(level.tiles), np.int64)  # with how many samples it was taken last
        self._measured_at = np.zeros(len(level.tiles), np.int64)  # with how many samples its noise was looked at
        self._noise = np.full(len(level.tiles), np.inf)  # as it was then
        self._color = np.zeros((2, 3, level.height, level.width), np.int64)  # of the half of the samples, and of the rest
        self._samples = np.zeros((2, level.height, level.width), np.int16)  # those that count

    @property
    def samples(self) -> int:
        """What every pixel has at least."""
        return int(self._counts.min())

    @property
    def mean_samples(self) -> float:
        """What a pixel has on the average."""
        return float((self._areas * self._counts).sum() / self._areas.sum())

    @property
    def is_complete(self) -> bool:
        """Whether all tiles are."""
        return bool((self._ended | (self._counts >= self.level.samples)).all())

    @property
    def noise(self) -> float | None:
        """Relative: the root mean square over its tiles, as of a job's frame; None while it is not known."""
        if not self._measured_at.all() or not np.isfinite(self._noise).all():
            return None
        squares = self._noise**2 * self._measured_at / self._counts  # those that went on since they were looked at included
        return math.sqrt(float((squares * self._areas).sum() / self._areas.sum()))

    def tile_is_complete(self, tile: int) -> bool:
        """Whether nothing more is wanted of it."""
        return bool(self._ended[tile] or self._counts[tile] >= self.level.samples)

    def add(self, tile: int, first: int, count: int, sums: Sums) -> None:
        """Add a piece's sums, (CHANNELS, h, w): all its samples are in the same half (renderer.film.in_half)."""
        place = self._place(tile)
        half = 0 if film.in_half(first) else 1
        self._color[half][:, *place] += sums[COLOR]
        self._samples[half][place] += sums[SAMPLES].astype(np.int16)
        self._counts[tile] += count
        has = int(self._counts[tile])
        if has >= max(FIRST_LOOK, 2 * self._measured_at[tile]) or has >= self.level.samples >= FIRST_LOOK:
            self._measured_at[tile], self._noise[tile] = has, self._noise_of(tile)
            if self._wanted is not None and has >= FIRST_CHECK and self._noise[tile] <= self._wanted:
                self._ended[tile] = True
        if self.tile_is_complete(tile) or has >= GROWTH * self._shown[tile]:
            self.changed[tile] = None

    def take(self, tile: int) -> tuple[npt.NDArray[np.float32], int, bool]:
        """A tile to be shown: its mean (3, h, w), with how many samples, and whether it is complete."""
        self.changed.pop(tile, None)
        self._shown[tile] = self._counts[tile]
        rows, columns = self._place(tile)
        samples = np.maximum(self._samples[:, rows, columns].sum(0), 1)
        color = self._color[0, :, rows, columns] + self._color[1, :, rows, columns]
        mean: npt.NDArray[Any] = color * (2.0**-self.film_exponent / samples)
        return mean.astype(np.float32), int(self._counts[tile]), self.tile_is_complete(tile)

    def _noise_of(self, tile: int) -> float:
        rows, columns = self._place(tile)
        color, samples = self._color[:, :, rows, columns], self._samples[:, rows, columns]
        sums = np.zeros((CHANNELS, *samples.shape[1:]), np.int64)
        sums[COLOR], sums[COLOR_HALF] = color[0] + color[1], color[0]
        sums[SAMPLES], sums[SAMPLES_HALF] = samples[0] + samples[1], samples[0]
        return film.noise(sums, self.film_exponent)

    def _place(self, tile: int) -> tuple[slice, slice]:
        rect = self.level.tiles[tile]
        return slice(rect.y, rect.y + rect.h), slice(rect.x, rect.x + rect.w)
