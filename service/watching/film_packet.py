"""Packet with the picture of a whole frame for the page (protocol.pictures), made from a film."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from protocol.pictures import encode_film, planes_of
from renderer.film import CHANNELS
from renderer.image import rgbe9995
from service.store.bands import bands
from service.store.film_moment import ReadableFilm
from service.watching.picture_response import PictureBody

__all__ = ["GZIP", "decompressed", "film_packet", "packet_memory", "picture_packet"]

GZIP = 31  # zlib's wbits for gzip
LEVEL = 1  # mantissas are noise: higher levels take longer and save nothing
PIECE = 1 << 18


def film_packet(film: ReadableFilm, frame: int, folder: Path, gzip: bool) -> PictureBody:
    """Returns the packet of a frame. Raises the errors of reading a film.

    frame: key of the frame: 2 * frame number, since frame numbers are multiples of 0.5. folder: for temporary files. gzip:
    whether to compress the packet.
    """
    # Counted before radiance is read: a tile that gets samples in between reports too few, and is sent again.
    samples = [film.coverage(frame, tile).total for tile in range(len(film.tiles))]
    planes = np.empty((4, film.height, film.width), np.uint8)
    y = 0
    for band in bands(film, frame, ("color",)):
        planes[:, y : y + len(band)] = planes_of(rgbe9995.pack(band))
        y += len(band)
    pieces = encode_film(frame // 2, (film.width, film.height), max(film.tiles[0][2:]), samples, planes)
    if not gzip:
        return PictureBody.from_bytes(b"".join(pieces), folder)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            for piece in _compress_chunks(pieces):
                file.write(piece)

    return PictureBody.from_writer(write, folder, ".gz")


def picture_packet(words: npt.NDArray[np.uint32]) -> Iterator[bytes]:
    """Yields a gzip-compressed packet of an uploaded picture: one tile with one sample per pixel.

    words: RGB9E5 values, shape (h, w).
    """
    height, width = words.shape
    yield from _compress_chunks(encode_film(0, (width, height), max(width, height), [1], planes_of(words)))


def decompressed(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Decompresses a gzip stream, for clients that do not accept gzip."""
    unpacker = zlib.decompressobj(GZIP)
    for piece in pieces:
        yield unpacker.decompress(piece)
    yield unpacker.flush()


def _compress_chunks(pieces: Iterable[memoryview]) -> Iterator[bytes]:
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, GZIP)
    for piece in pieces:
        for at in range(0, len(piece), PIECE):
            yield packer.compress(piece[at : at + PIECE])
    yield packer.flush()


def packet_memory(film: ReadableFilm) -> int:
    """Returns the estimated peak memory of `film_packet` for this film, in bytes."""
    tile = film.tiles[0]
    return 5 * film.width * tile.h * 12 + 3 * CHANNELS * tile.w * tile.h * 8 + 9 * film.width * film.height
