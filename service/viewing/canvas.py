"""Accumulated picture of a live view: exact sums of colour, noise estimates, and the tiles whose picture has changed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer import film
from renderer.film import ALBEDO, ALPHA_PLANES, CHANNELS, COLOR, COLOR_HALF, NORMAL, SAMPLES, SAMPLES_HALF, Sums
from service.scheduling.jobs.active_frame import FIRST_ESTIMATE_SAMPLES
from service.scheduling.jobs.plan import first_check
from service.viewing.passes import FIRST_GUIDES, Level

__all__ = ["BYTES_A_PIXEL", "GROWTH", "Canvas"]

BYTES_A_PIXEL = 52  # in memory; 32 more with alpha
GROWTH = 1.5  # a tile is shown again with so many times the samples: less is hardly visible


class Canvas:
    """Sums of the samples of one resolution level of a view.

    Each range of a tile's samples is added once; the order does not matter. noise: relative noise at which a tile is complete,
    checked at 32, 64, 128 ... samples; None: tiles get all samples. Tiles of few pixels are checked later (`first_check`).
    is_transparent: whether the background is, so that tiles have alpha. has_guides: whether it has sums of albedo and
    normal (`add_guides`).
    """

    def __init__(
        self,
        level: Level,
        film_exponent: int,
        noise: float | None = None,
        *,
        is_transparent: bool = False,
        has_guides: bool = False,
    ) -> None:
        self.level = level
        self.film_exponent = film_exponent
        self.changed: dict[int, None] = {}  # tiles to be shown again, oldest change first
        self._wanted = noise
        self._areas = np.array([tile.w * tile.h for tile in level.tiles], np.int64)
        self._first_checks = np.array([first_check(tile) for tile in level.tiles], np.int64)
        self._counts = np.zeros(len(level.tiles), np.int64)  # samples per pixel, by tile
        self._ended = np.zeros(len(level.tiles), bool)  # whether the tile has reached the noise target
        self._shown = np.zeros(len(level.tiles), np.int64)  # samples per pixel when the tile was taken last
        self._measured_at = np.zeros(len(level.tiles), np.int64)  # samples per pixel when the noise was measured last
        self._noise = np.full(len(level.tiles), np.inf)  # noise at that time
        self._color = np.zeros((2, 3, level.height, level.width), np.int64)  # sums of either half of the samples
        self._samples = np.zeros((2, level.height, level.width), np.int16)  # valid samples of either half
        self._alpha = np.zeros((ALPHA_PLANES, level.height, level.width), np.int64) if is_transparent else None
        shape = (7, level.height, level.width) if has_guides else (7, 0, 0)
        self._guides = np.zeros(shape, np.float32)  # sums of albedo and normal, and their samples
        self._guide_counts = np.zeros(len(level.tiles), np.int64)  # samples per pixel of the guides, by tile

    @property
    def samples(self) -> int:
        """Samples per pixel of the tile that has the fewest."""
        return int(self._counts.min())

    @property
    def most_shown(self) -> int:
        """Samples per pixel of the tile that was taken with the most."""
        return int(self._shown.max())

    @property
    def mean_samples(self) -> float:
        """Samples per pixel, averaged over all pixels."""
        return float((self._areas * self._counts).sum() / self._areas.sum())

    @property
    def is_complete(self) -> bool:
        """Returns True if no tile needs more samples."""
        return bool((self._ended | (self._counts >= self.level.samples)).all())

    @property
    def noise(self) -> float | None:
        """Relative noise, as the root mean square over all pixels of the tiles' noise; None until every tile is measured."""
        if not self._measured_at.all() or not np.isfinite(self._noise).all():
            return None
        squares = self._noise**2 * self._measured_at / self._counts  # scaled to the current number of samples
        return math.sqrt(float((squares * self._areas).sum() / self._areas.sum()))

    def tile_is_complete(self, tile: int) -> bool:
        """Returns True if a tile needs no more samples."""
        return bool(self._ended[tile] or self._counts[tile] >= self.level.samples)

    def add(self, tile: int, first: int, count: int, sums: Sums) -> None:
        """Adds the sums of one range of a tile's samples, shape (planes, h, w).

        tile: the tile's index. first, count: the sample numbers, all of which are in the same half (renderer.film.in_half).
        """
        place = self._slices(tile)
        half = 0 if film.in_half(first) else 1
        self._color[half][:, *place] += sums[COLOR]
        self._samples[half][place] += sums[SAMPLES].astype(np.int16)
        if self._alpha is not None:
            self._alpha[:, place[0], place[1]] += sums[film.alpha_plane(0) :]
        self._counts[tile] += count
        has = int(self._counts[tile])
        if has >= max(FIRST_ESTIMATE_SAMPLES, 2 * self._measured_at[tile]) or has >= self.level.samples >= FIRST_ESTIMATE_SAMPLES:
            self._measured_at[tile], self._noise[tile] = has, self._noise_of(tile)
            if self._wanted is not None and has >= self._first_checks[tile] and self._noise[tile] <= self._wanted:
                self._ended[tile] = True
        if self.tile_is_complete(tile) or has >= GROWTH * self._shown[tile]:
            self.changed[tile] = None

    def add_guides(self, tile: int, count: int, sums: Sums) -> None:
        """Adds albedo and normal of `count` samples of a tile to the denoiser's guides. tile: its index. sums: (planes, h, w)."""
        place = self._slices(tile)
        for planes, of in ((slice(0, 3), ALBEDO), (slice(3, 6), NORMAL)):
            self._guides[planes, place[0], place[1]] += (sums[of] * 2.0**-self.film_exponent).astype(np.float32)
        self._guides[6][place] += sums[SAMPLES]
        self._guide_counts[tile] += count

    @property
    def has_all_guides(self) -> bool:
        """Returns True if every tile has the guides of FIRST_GUIDES samples."""
        return bool((self._guide_counts >= FIRST_GUIDES).all())

    def take_tile(self, tile: int) -> tuple[npt.NDArray[np.float32], int, bool, npt.NDArray[np.uint8] | None]:
        """Returns a tile's mean colour, shape (3, h, w), its samples per pixel, and whether it is complete; then its alpha.

        The alpha is (h, w), 0 ... 255; None for an opaque background. Marks the tile as sent.
        """
        self.changed.pop(tile, None)
        self._shown[tile] = self._counts[tile]
        rows, columns = self._slices(tile)
        samples = np.maximum(self._samples[:, rows, columns].sum(0), 1)
        color = self._color[0, :, rows, columns] + self._color[1, :, rows, columns]
        mean: npt.NDArray[Any] = color * (2.0**-self.film_exponent / samples)
        return mean.astype(np.float32), int(self._counts[tile]), self.tile_is_complete(tile), self._alpha_of(rows, columns)

    def _alpha_of(self, rows: slice, columns: slice) -> npt.NDArray[np.uint8] | None:
        if self._alpha is None:
            return None
        planes = self._alpha[:, rows, columns]
        sums = np.zeros((film.plane_count(0, is_transparent=True), *planes.shape[1:]), np.int64)
        sums[SAMPLES] = self._samples[:, rows, columns].sum(0)
        sums[film.alpha_plane(0) :] = planes
        return np.rint(255 * film.alpha(sums, self.film_exponent, 0)).astype(np.uint8)

    def mean_color(self) -> npt.NDArray[np.float32]:
        """Returns the mean colour, (h, w, 3)."""
        samples = np.maximum(self._samples.sum(0), 1)
        color = (self._color.sum(0) * (2.0**-self.film_exponent / samples)).astype(np.float32)
        return np.moveaxis(color, 0, -1)

    def means(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Returns the means of colour, albedo and normal, each (h, w, 3), of a canvas with guides."""
        guides = self._guides[:6] / np.maximum(self._guides[6], 1)
        return self.mean_color(), np.moveaxis(guides[:3], 0, -1), np.moveaxis(guides[3:], 0, -1)

    def _noise_of(self, tile: int) -> float:
        rows, columns = self._slices(tile)
        color, samples = self._color[:, :, rows, columns], self._samples[:, rows, columns]
        sums = np.zeros((CHANNELS, *samples.shape[1:]), np.int64)
        sums[COLOR], sums[COLOR_HALF] = color[0] + color[1], color[0]
        sums[SAMPLES], sums[SAMPLES_HALF] = samples[0] + samples[1], samples[0]
        return film.noise(sums, self.film_exponent)

    def _slices(self, tile: int) -> tuple[slice, slice]:
        rect = self.level.tiles[tile]
        return slice(rect.y, rect.y + rect.h), slice(rect.x, rect.x + rect.w)
