"""A view's picture as it comes to be: exact sums of colour in memory, and which tiles have changed since they were looked at."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.film import COLOR, SAMPLES, Sums
from renderer.image import rgbe9995
from service.viewing.passes import Level

__all__ = ["Canvas"]


class Canvas:
    """The sums of one level. Each piece is to be added once, in any order."""

    def __init__(self, level: Level, film_exponent: int) -> None:
        self.level = level
        self.film_exponent = film_exponent
        self.counts = [0] * len(level.tiles)  # samples of each tile's pixels
        self.changed: dict[int, None] = {}  # tiles, in the order of their first change
        self._color = np.zeros((3, level.height, level.width), np.int64)
        self._samples = np.zeros((level.height, level.width), np.int32)  # those that count

    @property
    def samples(self) -> int:
        """What every pixel has at least."""
        return min(self.counts)

    @property
    def has_any(self) -> bool:
        """Whether any tile has samples."""
        return any(self.counts)

    def add(self, tile: int, count: int, sums: Sums) -> None:
        """Add a piece's sums, (CHANNELS, h, w)."""
        rect = self.level.tiles[tile]
        place = (slice(rect.y, rect.y + rect.h), slice(rect.x, rect.x + rect.w))
        self._color[:, *place] += sums[COLOR]
        self._samples[place] += sums[SAMPLES].astype(np.int32)
        self.counts[tile] += count
        self.changed[tile] = None

    def words(self, tile: int) -> bytes:
        """A tile's mean as RGB9E5 words, little-endian."""
        rect = self.level.tiles[tile]
        rows, columns = slice(rect.y, rect.y + rect.h), slice(rect.x, rect.x + rect.w)
        samples = np.maximum(self._samples[rows, columns], 1)
        mean: npt.NDArray[Any] = self._color[:, rows, columns] * (2.0**-self.film_exponent / samples)
        return rgbe9995.pack(np.moveaxis(mean, 0, -1).astype(np.float32)).astype("<u4").tobytes()
