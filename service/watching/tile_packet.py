"""The packet of a live tile, little-endian.

u8 version = 1, u8 kind = 1, u16 frame (its integer part, modulo 65536), u32 seq, u16 x, y, w, h, u32 spp, then w * h RGB9E5
words, rows from the top.
"""

from __future__ import annotations

import struct

from renderer import film as film_math
from renderer.film import CHANNELS, COLOR, SAMPLES
from renderer.image import rgbe9995
from service.store.films import Film

__all__ = ["KIND_TILE", "VERSION", "body", "packet"]

VERSION = 1
KIND_TILE = 1
PLANES = (*range(CHANNELS)[COLOR], SAMPLES)
HEADER = struct.Struct("<BBHIHHHHI")


def body(film: Film, frame: int, tile: int) -> tuple[int, bytes] | None:
    """Returns a tile's samples per pixel and its mean colour as RGB9E5 words; None without samples."""
    sums = film.tile_planes(frame, tile, PLANES)
    if sums is None:
        return None
    spp = film.coverage(frame, tile).total
    return spp, rgbe9995.pack(film_math.mean(sums, film.film_exponent)).astype("<u4").tobytes()


def packet(film: Film, frame: int, tile: int, seq: int, spp: int, words: bytes) -> bytes:
    """Returns the complete packet of a tile."""
    x, y, w, h = film.tiles[tile]
    return HEADER.pack(VERSION, KIND_TILE, frame // 2 & 0xFFFF, seq & 0xFFFFFFFF, x, y, w, h, spp) + words
