"""The packet of a whole frame, for a page that opens it. Little-endian.

u8 version = 1, u8 kind = 2, u16 frame (its integer part, modulo 65536), u16 w, h, u32 tile size; then u32 samples per pixel of
every tile, in reading order; then w * h RGB9E5 words in four byte planes, the lowest byte first, rows from the top.

Byte planes compress better: neighbouring exponents are similar, mantissas are noise.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from renderer.film import CHANNELS
from renderer.image import rgbe9995
from service.store.bands import bands
from service.store.film_moment import Readable
from service.watching.picture_response import Made
from service.watching.tile_packet import VERSION

__all__ = ["GZIP", "HEADER", "KIND_FILM", "film_packet", "memory", "packed_picture", "unpacked"]

KIND_FILM = 2
HEADER = struct.Struct("<BBHHHI")
GZIP = 31  # zlib's wbits for gzip
LEVEL = 1  # mantissas are noise: higher levels take longer and save nothing
PIECE = 1 << 18


def film_packet(film: Readable, frame: int, folder: Path, gzip: bool) -> Made:
    """Returns the packet of a frame. folder: for temporary files. Raises what reading a film raises."""
    # Counted before radiance is read: a tile that gets samples in between reports too few, and is sent again.
    samples = np.array([film.coverage(frame, tile).total for tile in range(len(film.tiles))], "<u4")
    planes = np.empty((4, film.height, film.width), np.uint8)
    y = 0
    for band in bands(film, frame, ("color",)):
        words = rgbe9995.pack(band).astype("<u4")
        planes[:, y : y + len(band)] = np.moveaxis(words.view(np.uint8).reshape(*words.shape, 4), 2, 0)
        y += len(band)
    head = HEADER.pack(VERSION, KIND_FILM, frame // 2 & 0xFFFF, film.width, film.height, max(film.tiles[0][2:]))
    if not gzip:
        return Made.of(head + samples.tobytes() + planes.tobytes(), folder)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            for piece in _compressed(head + samples.tobytes(), planes):
                file.write(piece)

    return Made.written(write, folder, ".gz")


def packed_picture(words: npt.NDArray[np.uint32]) -> Iterator[bytes]:
    """Yields a gzip-compressed packet of an uploaded picture, RGB9E5 words (h, w), as one tile with one sample per pixel."""
    height, width = words.shape
    planes = np.ascontiguousarray(np.moveaxis(words.astype("<u4").view(np.uint8).reshape(height, width, 4), 2, 0))
    yield from _compressed(HEADER.pack(VERSION, KIND_FILM, 0, width, height, max(width, height)) + struct.pack("<I", 1), planes)


def unpacked(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Decompresses a gzip stream, for clients that do not accept gzip."""
    unpacker = zlib.decompressobj(GZIP)
    for piece in pieces:
        yield unpacker.decompress(piece)
    yield unpacker.flush()


def _compressed(head: bytes, planes: np.ndarray) -> Iterator[bytes]:
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, GZIP)
    yield packer.compress(head)
    flat = planes.reshape(-1)
    for at in range(0, len(flat), PIECE):
        yield packer.compress(flat[at : at + PIECE].data)
    yield packer.flush()


def memory(film: Readable) -> int:
    """Returns the estimated peak memory of `film_packet`, in bytes."""
    tile = film.tiles[0]
    return 5 * film.width * tile.h * 12 + 3 * CHANNELS * tile.w * tile.h * 8 + 9 * film.width * film.height
