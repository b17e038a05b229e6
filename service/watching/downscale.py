"""Downscales pictures that are read in bands of rows, by averaging squares of pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["reduced_bands", "square_side"]


def square_side(min_width: int | None, width: int, height: int) -> int:
    """Returns the side in pixels of the squares to average for a copy at least `min_width` pixels wide; 1 keeps the size.

    width, height: size of the original. min_width: None keeps the size.
    """
    return max(1, min(width // (min_width or width), height))


def reduced_bands(bands: Iterable[npt.NDArray[Any]], side: int) -> Iterator[npt.NDArray[Any]]:
    """Yields the bands of a picture downscaled by averaging squares, in the input's dtype.

    bands: consecutive rows of the picture, each of shape (rows, width, channels). side: of the squares in pixels. Incomplete
    squares at the right and lower edges are dropped.
    """
    if side == 1:
        yield from bands
        return
    total: npt.NDArray[np.float64] | None = None  # sums of the squares so far
    have = 0
    for band in bands:
        rows, width, channels = band.shape
        columns = width // side
        across = band[:, : columns * side].reshape(rows, columns, side, channels).sum(axis=2, dtype=np.float64)
        done = []
        at = 0
        while at < rows:
            take = min(side - have, rows - at)
            part = across[at : at + take].sum(axis=0)
            total = part if total is None else total + part
            at, have = at + take, have + take
            if have == side:
                done.append(total / side**2)
                total, have = None, 0
        if done:
            yield np.stack(done).astype(band.dtype)
