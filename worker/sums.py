"""A batch's sums as bytes, on their way from a worker and in a film's files."""

from __future__ import annotations

from collections.abc import Iterable

import lz4.block
import numpy as np

from renderer.film import CHANNELS, Sums
from renderer.settings import Tile

__all__ = ["pack_sums", "unpack_sums"]


def pack_sums(sums: Sums) -> bytes:
    """A batch's sums, LZ4-compressed with the low and the high words apart: the high ones are nearly constant and vanish."""
    words = np.ascontiguousarray(sums, dtype="<i8").reshape(-1, 1).view("<u4")
    return lz4.block.compress(np.ascontiguousarray(words.T), store_size=False)


def unpack_sums(data: bytes, tile: Tile, stored: bool = False, planes: Iterable[int] | None = None) -> Sums:
    """The sums that `pack_sums` packed, (CHANNELS, h, w) int64. Raises ValueError where they are not of this tile.

    stored: an older release may have packed them, which knew fewer planes; those that came since are 0.
    planes: fill these alone; the others stay 0, and take neither time nor memory."""
    plane = tile.h * tile.w * 8
    size = CHANNELS * plane
    try:
        raw = lz4.block.decompress(data, uncompressed_size=size)
    except lz4.block.LZ4BlockError as error:
        raise ValueError(f"damaged sums: {error}") from error
    if len(raw) != size and not (stored and raw and len(raw) % plane == 0):
        raise ValueError(f"sums of {len(raw)} bytes where the tile has {size}")
    words = np.frombuffer(raw, "<u4").reshape(2, -1, tile.h, tile.w)  # low, high
    known = words.shape[1]
    sums = np.zeros((CHANNELS, tile.h, tile.w), "<i8")
    pairs = sums.view("<u4").reshape(CHANNELS, tile.h, tile.w, 2)
    for i in range(known) if planes is None else planes:
        if i < known:
            pairs[i, ..., 0], pairs[i, ..., 1] = words[:, i]
    return sums
