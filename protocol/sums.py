"""Serialization of a batch's sums, for sending them from a worker and for storing them in a film.

Packed sums consist of a format byte, the number of planes, a head for each plane (a code and a number), and the planes' bodies. A
plane whose pixels are equal is stored as their value. A plane that equals an earlier one is stored as that plane's number: with a
single sample, the half film equals the whole film or is zero. Every other plane uses the narrowest integer type that holds its
values and is LZ4-compressed separately, so readers that need only colour decompress only those planes.

Counts of Cryptomatte (renderer/cryptomatte.py) follow the planes: a head, and one LZ4 block of the pixels' indices (differences),
kinds and ids, and counts. Deep pixels (renderer/deep.py) follow these, packed by protocol/deep_sums.py.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Annotated, Any, NamedTuple

import lz4.block
import numpy as np
import numpy.typing as npt

from protocol.deep_sums import pack_deep, samples_in_depth, unpack_deep_block
from protocol.layout import I64, U8, U32, Layout
from renderer import cryptomatte, deep
from renderer.cryptomatte import Hits, no_hits
from renderer.deep import MOST_DEEP, Deep
from renderer.film import CHANNELS, SAMPLES, Sums, is_plane_count
from renderer.sentences import Sentence
from renderer.settings import Tile

__all__ = [
    "PACKED",
    "add_sums",
    "check_sums",
    "check_weight",
    "merge_deep",
    "merge_hits",
    "pack_sums",
    "unpack_deep",
    "unpack_hits",
    "unpack_sums",
]

Array = npt.NDArray[Any]

PACKED = 2  # format byte; the older format is one LZ4 block, whose first byte is 16 or more
WITH_HITS = 3  # format byte of sums with counts of Cryptomatte behind them
WITH_DEEP = 4  # and with deep pixels behind these; the counts have no entries without Cryptomatte
MOST_HITS = 1 << 26  # of a tile, whatever its samples
ALIKE, COPY = 0, 9
PLAIN = 10  # uncompressed, 8 bytes a pixel: only from the older format
WIDTHS = {1: "<i1", 2: "<i2", 4: "<i4", 8: "<i8"}  # bytes a pixel


class Start(NamedTuple):
    """The start of packed sums. A PlaneHead for each plane follows, then the planes' bodies."""

    format: Annotated[int, U8, "PACKED, WITH_HITS or WITH_DEEP"]
    planes: Annotated[int, U8, "number of planes"]


class PlaneHead(NamedTuple):
    """The head of one plane: how its pixels are stored."""

    code: Annotated[int, U8, "ALIKE, COPY, or the bytes per pixel"]
    value: Annotated[int, I64, "the value of all pixels, the number of the plane that is equal, or the size of the body"]


class HitsHead(NamedTuple):
    """The head of Cryptomatte's counts, behind the planes' bodies."""

    entries: Annotated[int, U32, "number of pairs of a pixel and an id"]
    size: Annotated[int, U32, "bytes of the block that follows"]


HITS = Layout("counts of Cryptomatte", HitsHead)
START = Layout("batch of sums", Start)
PLANE = Layout("plane of sums", PlaneHead)


def pack_sums(
    sums: Sums,
    packing: int = PACKED,
    hits: Hits | None = None,
    deep_pixels: Deep | None = None,
    planes: Collection[int] | None = None,
) -> bytes:
    """Packs a batch's sums, (planes, h, w) int64. Equal sums give equal bytes.

    packing: the format: the newest one that the receiver supports, or 1 for releases before 0.2. hits: counts of Cryptomatte;
    None if they were not requested. deep_pixels: likewise. planes: pack the others as if they were 0, without reading them;
    not for packing 1.
    """
    if packing < PACKED:
        return lz4.block.compress(_encode_plane(sums, 8), store_size=False)
    heads: list[bytes] = []
    bodies: list[bytes] = []
    seen: dict[tuple[int, int], list[int]] = {}
    for number, plane in enumerate(sums):
        if planes is not None and number not in planes:
            heads.append(PLANE.pack(PlaneHead(ALIKE, 0)))
            continue
        least, most = (int(plane.min()), int(plane.max())) if plane.size else (0, 0)
        if least == most:
            heads.append(PLANE.pack(PlaneHead(ALIKE, least)))
            continue
        others = seen.setdefault((least, most), [])
        twin = next((other for other in others if np.array_equal(sums[other], plane)), None)
        if twin is not None:
            heads.append(PLANE.pack(PlaneHead(COPY, twin)))
            continue
        others.append(number)
        width = next(width for width in WIDTHS if -(1 << 8 * width - 1) <= least and most < 1 << 8 * width - 1)
        body = lz4.block.compress(_encode_plane(plane, width), store_size=False)
        heads.append(PLANE.pack(PlaneHead(width, len(body))))
        bodies.append(body)
    if deep_pixels is not None:
        further = [*_packed_hits(hits or no_hits()), *pack_deep(deep_pixels)]
        return b"".join([START.pack(Start(WITH_DEEP, len(sums))), *heads, *bodies, *further])
    if hits is None:
        return b"".join([START.pack(Start(PACKED, len(sums))), *heads, *bodies])
    return b"".join([START.pack(Start(WITH_HITS, len(sums))), *heads, *bodies, *_packed_hits(hits)])


def _packed_hits(hits: Hits) -> list[bytes]:
    place, number = (hits.key >> np.uint64(32)).astype(np.int64), hits.key.astype("<u4")
    columns = np.diff(place, prepend=0).astype("<u4"), number, hits.count.astype("<u4")
    block = lz4.block.compress(b"".join(column.tobytes() for column in columns), store_size=False)
    return [HITS.pack(HitsHead(len(place), len(block))), block]


def unpack_hits(data: bytes, tile: Tile, stored: bool = False, most: int = MOST_HITS) -> Hits | None:
    """Unpacks Cryptomatte's counts; None if there are none behind these sums.

    most: the largest number of entries that is unpacked. Raises ValueError if the counts exceed it or do not fit the tile.
    """
    if not data or data[0] not in (WITH_HITS, WITH_DEEP):
        return None
    at, entries, end = _find_hits(data, tile, stored)
    if entries > most:
        raise ValueError(Sentence("sums-hits", "damaged sums: their counts of objects are not in order"))
    if data[0] == WITH_HITS and end != len(data):
        raise ValueError(Sentence("sums-too-long", "damaged sums: data follows their end"))
    if entries == 0:
        return no_hits()
    raw = np.frombuffer(_decompress(memoryview(data)[at:end], 12 * entries), np.uint8)
    if len(raw) != 12 * entries:
        raise ValueError(
            Sentence("sums-size", "sums have {bytes} bytes, but the tile needs {expected}", bytes=len(raw), expected=12 * entries)
        )
    step, number, count = raw.view("<u4").reshape(3, entries).astype(np.uint64)
    place = np.cumsum(step)
    key = place << np.uint64(32) | number
    is_sorted = bool((key[1:] > key[:-1]).all())
    if not is_sorted or place[-1] >= tile.w * tile.h or not count.all() or not (number & np.uint64(0x7FFFFFFF)).all():
        raise ValueError(Sentence("sums-hits", "damaged sums: their counts of objects are not in order"))
    return Hits(key, count.astype(np.int64))


def _find_hits(data: bytes, tile: Tile, stored: bool) -> tuple[int, int, int]:
    """Returns (start of the block with Cryptomatte's counts, number of its entries, its end). Raises ValueError if it is cut."""
    at = _end_of_planes(data, tile, stored)
    try:
        entries, size = HITS.unpack(data, at)
    except ValueError:
        entries, size = 0, len(data)
    end = at + HITS.size + size
    if end > len(data):
        raise ValueError(Sentence("sums-truncated", "damaged sums: the data ends early"))
    return at + HITS.size, entries, end


def unpack_deep(data: bytes, tile: Tile, stored: bool = False, samples: int = MOST_DEEP) -> Deep | None:
    """Unpacks deep pixels; None if there are none behind these sums. Raises ValueError if they do not fit the tile.

    samples: the most of a pixel; raises ValueError, before they are unpacked, if there are more entries.
    """
    if not data or data[0] != WITH_DEEP:
        return None
    return unpack_deep_block(data, _find_hits(data, tile, stored)[2], tile.w * tile.h, samples)


def merge_hits(parts: Iterable[bytes], tile: Tile, stored: bool = False) -> Hits | None:
    """Returns the sum of Cryptomatte's counts behind packed sums; None if none of them has any."""
    found = [hits for data in parts if (hits := unpack_hits(data, tile, stored)) is not None]
    return cryptomatte.merged(found) if found else None


def merge_deep(parts: Iterable[bytes], tile: Tile, stored: bool = False) -> Deep | None:
    """Returns the sum of the deep pixels behind packed sums; None if none of them has any."""
    found = [each for data in parts if (each := unpack_deep(data, tile, stored)) is not None]
    return deep.merged(found) if found else None


def unpack_sums(data: bytes, tile: Tile, stored: bool = False, planes: Iterable[int] | None = None) -> Sums:
    """Unpacks sums from `pack_sums` to (planes, h, w) int64. Raises ValueError if their size is not that of the tile.

    stored: whether to accept sums that an older release stored with fewer planes; missing planes are 0. planes: unpack only
    these; the others are 0 and cost neither time nor memory.
    """
    known = dict(_planes(data, tile, stored))
    wanted = known.keys() if planes is None else known.keys() & planes
    count = max(CHANNELS, len(known))
    sums = (np.empty if len(wanted) == count else np.zeros)((count, tile.h, tile.w), "<i8")
    for number in wanted:
        code, value, body = known[number]
        if code == COPY:
            code, value, body = known[value]
        if code == ALIKE:
            sums[number] = value
        elif code == PLAIN:
            _unpack_plane(body, 8, sums[number])
        else:
            _unpack_plane(_checked_bytes(body, code, tile), code, sums[number])
    return sums


def add_sums(total: Sums, data: bytes, tile: Tile, stored: bool = False, planes: Collection[int] | None = None) -> None:
    """Adds packed sums, or some of their planes, to `total` in place.

    stored: whether to accept sums that an older release stored with fewer planes. planes: numbers of the planes to add; None:
    all. Raises ValueError if the sums do not fit the tile or the planes of `total`, which is then unchanged.
    """
    known = dict(_planes(data, tile, stored))
    if len(known) > len(total) or (not stored and len(known) < len(total)):
        raise _plane_count_error(len(known), len(total))
    wanted = known.keys() if planes is None else known.keys() & planes
    wanted |= {known[number][1] for number in wanted if known[number][0] == COPY}
    values: dict[int, Any] = {}
    for number in sorted(wanted):  # a copy follows its original
        code, value, body = known[number]
        if code == COPY:
            values[number] = values[value]
        elif code == ALIKE:
            values[number] = value
        elif code in WIDTHS and code < 8:
            values[number] = np.frombuffer(_checked_bytes(body, code, tile), WIDTHS[code]).reshape(tile.h, tile.w)
        else:
            values[number] = np.empty((tile.h, tile.w), "<i8")
            _unpack_plane(body if code == PLAIN else _checked_bytes(body, code, tile), 8, values[number])
    for number, value in values.items():
        if planes is None or number in planes:
            total[number] += value


def check_sums(data: bytes, tile: Tile) -> None:
    """Raises ValueError if `unpack_sums`, `unpack_hits` or `unpack_deep` would raise it for these sums.

    Faster, since it returns no sums.
    """
    unpack_hits(data, tile)
    unpack_deep(data, tile)
    for code, _, body in dict(_planes(data, tile, False)).values():
        if code in WIDTHS:
            _checked_bytes(body, code, tile)


def check_weight(data: bytes, tile: Tile, count: int, planes: int | None = None, deep_samples: int | None = None) -> None:
    """Raises ValueError if any pixel has a negative number of samples, or more than `count`.

    planes: the number of planes of the film; raises ValueError for another number. deep_samples: likewise RenderSettings.deep.
    Also raises it if Cryptomatte or deep pixels count more samples in a pixel.
    """
    known = dict(_planes(data, tile, False))
    if planes is not None and len(known) != planes:
        raise _plane_count_error(len(known), planes)
    most = 0
    if (hits := unpack_hits(data, tile, most=2 * tile.w * tile.h * count)) is not None and len(hits.key):
        most = int(np.bincount(np.unique(hits.key >> np.uint64(31), return_inverse=True)[1], hits.count).max())
    found = unpack_deep(data, tile, samples=count)
    if deep_samples is not None and deep_samples != (0 if found is None else found.most):
        raise ValueError(
            Sentence(
                "sums-deep-samples",
                "the sums have {found} deep samples a pixel at most, but the job has {expected}",
                found=0 if found is None else found.most,
                expected=deep_samples,
            )
        )
    if found is not None:
        most = max(most, samples_in_depth(found))
    code, least, _ = known[SAMPLES]
    if code == ALIKE:
        most = max(most, least)
    else:
        sums = unpack_sums(data, tile, planes=[SAMPLES])[SAMPLES]
        least, most = int(sums.min()), max(most, int(sums.max()))
    if least < 0 or most > count:
        raise ValueError(
            Sentence(
                "sums-samples",
                "damaged sums: a pixel has {samples} samples, but the batch has {count}",
                samples=most if most > count else least,
                count=count,
            )
        )


def _planes(data: bytes, tile: Tile, stored: bool) -> Iterator[tuple[int, tuple[int, int, bytes | memoryview]]]:
    """Yields (plane number, (code, value, body)) of each plane.

    code: ALIKE (all pixels equal `value`), COPY (equal to the plane with the number `value`), or the number of bytes per pixel.
    """
    if not data or data[0] not in (PACKED, WITH_HITS, WITH_DEEP):
        yield from _planes_of_old_format(data, tile, stored)
        return
    try:
        count = START.unpack(data).planes
        heads = PLANE.unpack_all(data, START.size, count)
    except ValueError:
        raise ValueError(Sentence("sums-truncated", "damaged sums: the data ends early")) from None
    if not is_plane_count(count) and not (stored and 0 < count < CHANNELS):
        raise _plane_count_error(count, CHANNELS)
    view = memoryview(data)
    at = START.size + count * PLANE.size
    for number, (code, value) in enumerate(heads):
        body = view[at:at]
        if code in WIDTHS:
            if value < 0 or at + value > len(data):
                raise ValueError(Sentence("sums-truncated", "damaged sums: the data ends early"))
            body = view[at : at + value]
            at += value
        elif code == COPY and not (0 <= value < number and heads[value].code in WIDTHS):
            raise ValueError(Sentence("sums-copy", "damaged sums: plane {plane} copies plane {other}", plane=number, other=value))
        elif code not in (ALIKE, COPY):
            raise ValueError(
                Sentence("sums-plane-kind", "damaged sums: plane {plane} has the unknown kind {kind}", plane=number, kind=code)
            )
        yield number, (code, value, body)
    if data[0] != PACKED and at + HITS.size > len(data):
        raise ValueError(Sentence("sums-truncated", "damaged sums: the data ends early"))
    if at != len(data) and data[0] == PACKED:
        raise ValueError(Sentence("sums-too-long", "damaged sums: data follows their end"))


def _end_of_planes(data: bytes, tile: Tile, stored: bool) -> int:
    """Returns the offset behind the planes' bodies."""
    known = dict(_planes(data, tile, stored))
    return START.size + len(known) * PLANE.size + sum(value for code, value, _ in known.values() if code in WIDTHS)


def _planes_of_old_format(data: bytes, tile: Tile, stored: bool) -> Iterator[tuple[int, tuple[int, int, bytes | memoryview]]]:
    """Yields the planes of sums packed by releases before 0.2: low words of all planes, then high words, in one LZ4 block.

    The items are as in `_planes`.
    """
    size = CHANNELS * tile.h * tile.w * 8
    raw = _decompress(data, size)
    plane = tile.h * tile.w * 8
    if len(raw) != size and not (stored and raw and len(raw) % plane == 0):
        raise ValueError(
            Sentence("sums-size", "sums have {bytes} bytes, but the tile needs {expected}", bytes=len(raw), expected=size)
        )
    words = np.frombuffer(raw, "<u4").reshape(2, -1, tile.h * tile.w)
    for number in range(words.shape[1]):
        yield number, (PLAIN, 0, words[:, number].tobytes())


def _plane_count_error(planes: int, expected: int) -> ValueError:
    return ValueError(
        Sentence("sums-planes", "sums have {planes} planes, but the film has {expected}", planes=planes, expected=expected)
    )


def _encode_plane(plane: Array, width: int) -> bytes:
    if width == 8:  # separate the high words, which are nearly equal and compress well
        return np.ascontiguousarray(np.ascontiguousarray(plane, "<i8").reshape(-1, 1).view("<u4").T).tobytes()
    return plane.astype(WIDTHS[width]).tobytes()


def _unpack_plane(raw: bytes | memoryview, width: int, plane: Array) -> None:
    if width == 8:
        pairs = plane.view("<u4").reshape(-1, 2)
        pairs[:, 0], pairs[:, 1] = np.frombuffer(raw, "<u4").reshape(2, -1)
    else:
        plane[...] = np.frombuffer(raw, WIDTHS[width]).reshape(plane.shape)


def _checked_bytes(body: bytes | memoryview, width: int, tile: Tile) -> bytes:
    size = tile.h * tile.w * width
    raw = _decompress(body, size)
    if len(raw) != size:
        raise ValueError(
            Sentence("sums-size", "sums have {bytes} bytes, but the tile needs {expected}", bytes=len(raw), expected=size)
        )
    return raw


def _decompress(body: bytes | memoryview, size: int) -> bytes:
    try:
        raw: bytes = lz4.block.decompress(body, uncompressed_size=size)
    except lz4.block.LZ4BlockError as error:
        raise ValueError(
            Sentence("sums-compressed", "damaged sums: they cannot be decompressed ({error})", error=error)
        ) from error
    return raw
