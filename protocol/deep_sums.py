"""Serialization of deep pixels (renderer/deep.py): a head, and one LZ4 block with a column for each number of an entry.

The columns are the differences of the pixels' indices, levels and bins, numbers of samples, the low and the high words of the
other sums, and the depths.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import lz4.block
import numpy as np

from protocol.layout import U8, U32, Layout
from renderer.deep import COUNT, MOST_DEEP, MOST_LEVEL, SUMS, Deep, no_deep, pixels_of
from renderer.sentences import Sentence

__all__ = ["DEEP", "DeepHead", "pack_deep", "samples_in_depth", "unpack_deep_block"]

_ENTRY = 4 * (3 + 2 * (SUMS - 1) + 2)  # bytes
_LEVEL_AND_BIN = np.uint64(0xFFFFFFFF)


class DeepHead(NamedTuple):
    """The head of deep pixels."""

    most: Annotated[int, U8, "greatest number of entries of a pixel"]
    entries: Annotated[int, U32, "number of entries"]
    size: Annotated[int, U32, "bytes of the block that follows"]


DEEP = Layout("deep pixels", DeepHead)


def pack_deep(deep: Deep) -> list[bytes]:
    """Packs deep pixels. Equal ones give equal bytes."""
    words = np.ascontiguousarray(deep.sums[:, COUNT + 1 :].T, "<i8").view("<u4").reshape(SUMS - 1, -1, 2)
    columns = [
        np.diff(pixels_of(deep), prepend=0).astype("<u4"),
        deep.key.astype("<u4"),
        deep.sums[:, COUNT].astype("<u4"),
        np.moveaxis(words, 2, 1),
        deep.near.astype("<f4"),
        deep.far.astype("<f4"),
    ]
    block = lz4.block.compress(b"".join(column.tobytes() for column in columns), store_size=False)
    return [DEEP.pack(DeepHead(deep.most, len(deep.key), len(block))), block]


def unpack_deep_block(data: bytes, at: int, pixels: int, samples: int) -> Deep:
    """Unpacks deep pixels that end the data, from the offset `at` on. pixels: their number. samples: the most of a pixel.

    Raises ValueError if they are damaged, or have more entries than samples.
    """
    try:
        most, entries, size = DEEP.unpack(data, at)
    except ValueError:
        raise ValueError(Sentence("sums-truncated", "damaged sums: the data ends early")) from None
    if not 0 < most <= MOST_DEEP or entries > min(most, samples) * pixels:
        raise _order_error()
    if at + DEEP.size + size != len(data):
        raise ValueError(Sentence("sums-too-long", "damaged sums: data follows their end"))
    if not entries:
        return no_deep(most)
    try:
        raw = lz4.block.decompress(memoryview(data)[at + DEEP.size :], uncompressed_size=_ENTRY * entries)
    except lz4.block.LZ4BlockError as error:
        raise ValueError(
            Sentence("sums-compressed", "damaged sums: they cannot be decompressed ({error})", error=error)
        ) from error
    if len(raw) != _ENTRY * entries:
        raise ValueError(
            Sentence(
                "sums-size", "sums have {bytes} bytes, but the tile needs {expected}", bytes=len(raw), expected=_ENTRY * entries
            )
        )
    columns = np.frombuffer(raw, "<u4").reshape(-1, entries)
    pixel, low = np.cumsum(columns[0].astype(np.uint64)), columns[1].astype(np.uint64)
    sums = np.empty((entries, SUMS), np.int64)
    sums[:, COUNT] = columns[2]
    sums[:, COUNT + 1 :] = np.ascontiguousarray(columns[3:-2].reshape(SUMS - 1, 2, entries).transpose(2, 0, 1)).view("<i8")[
        ..., 0
    ]
    near, far = columns[-2:].view("<f4").astype(np.float32)
    found = Deep(most, pixel << np.uint64(32) | low, sums, near, far)
    if pixel[-1] >= pixels or not _is_in_order(found):
        raise _order_error()
    return found


def _is_in_order(deep: Deep) -> bool:
    """Returns True if keys ascend, each pixel has one level and at most `most` entries, and all have samples and a depth."""
    pixel, level = pixels_of(deep), deep.key >> np.uint64(24) & np.uint64(255)
    bins = deep.key & np.uint64((1 << 24) - 1)
    is_same = pixel[1:] == pixel[:-1]
    return (
        bool((deep.key[1:] > deep.key[:-1]).all())
        and bool((level[1:] == level[:-1])[is_same].all())
        and int(level.max()) <= MOST_LEVEL
        and not (bins >> np.uint64(MOST_LEVEL) - level).any()
        and int(np.bincount(pixel).max()) <= deep.most
        and bool((deep.sums[:, COUNT] > 0).all())
        and bool(((deep.near > 0) & (deep.near <= deep.far) & np.isfinite(deep.far)).all())
    )


def samples_in_depth(deep: Deep) -> int:
    """Returns the greatest number of samples of a pixel."""
    return int(np.bincount(pixels_of(deep), deep.sums[:, COUNT]).max(initial=0))


def _order_error() -> ValueError:
    return ValueError(Sentence("sums-deep", "damaged sums: their deep pixels are not in order"))
