"""A view's picture on the wire, little-endian:

u8 version = 2, u8 kind = 3, u16 tiles, u32 id (as the page named the view, modulo 2**32), u32 seq, u16 width, u16 height (of
this picture), u16 width, u16 height (of the view when it is whole), then of each tile u16 x, y, w, h and u32 samples a pixel, of
which the highest bit says that the tile is exact; and then, compressed (DEFLATE, raw):

of all tiles that are not exact, rows from the top, one tile behind the other, brightness (service/viewing/coarse.py) as what it
is more than the last one, where 0, -1, 1, -2 ... are written 0, 1, 2, 3 ...: the low bytes of all, then the high ones; then red's
share, and green's, as what they are more than the last one, modulo 256;

of all tiles that are exact their RGB9E5 words in four planes of bytes, the lowest first.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.image import rgbe9995
from renderer.settings import Tile
from service.viewing.coarse import coarse

__all__ = ["EXACT", "HEADER", "KIND_VIEW", "TILE", "VERSION", "Shown", "packet"]

VERSION = 2
KIND_VIEW = 3
EXACT = 1 << 31
HEADER = struct.Struct("<BBHIIHHHH")
TILE = struct.Struct("<HHHHI")
RAW = -15  # zlib's number for DEFLATE without a frame around it
LEVEL = 1  # what a higher one takes longer, it does not make smaller: this is noise


class Shown(NamedTuple):
    """A tile of a picture."""

    rect: Tile
    mean: npt.NDArray[np.float32]  # (3, h, w)
    samples: int
    is_exact: bool


def packet(tiles: list[Shown], size: tuple[int, int], whole: tuple[int, int], id: int, seq: int) -> bytes:
    """The whole message. size: of this picture. whole: of the view when it is whole."""
    head = [
        HEADER.pack(VERSION, KIND_VIEW, len(tiles), id & 0xFFFFFFFF, seq & 0xFFFFFFFF, *size, *whole),
        *(TILE.pack(*tile.rect, tile.samples | EXACT * tile.is_exact) for tile in tiles),
    ]
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, RAW)
    body = [packer.compress(plane.data) for plane in _planes(tiles)]
    return b"".join([*head, *body, packer.flush()])


def _planes(tiles: list[Shown]) -> list[npt.NDArray[np.uint8]]:
    found = []
    rough = [coarse(tile.mean) for tile in tiles if not tile.is_exact]
    if rough:
        codes: npt.NDArray[np.int16] = np.concatenate([codes.ravel() for codes, _ in rough])
        more = np.empty_like(codes)
        more[0] = codes[0]
        np.subtract(codes[1:], codes[:-1], out=more[1:])
        folded = (more << 1 ^ more >> 15).astype(np.uint16)
        found += [folded.astype(np.uint8), (folded >> 8).astype(np.uint8)]
        found += [np.diff(np.concatenate([hue[i].ravel() for _, hue in rough]), prepend=np.uint8(0)) for i in (0, 1)]
    exact = [rgbe9995.pack(np.moveaxis(tile.mean, 0, -1)).astype("<u4").ravel() for tile in tiles if tile.is_exact]
    if exact:
        found += list(np.ascontiguousarray(np.concatenate(exact).view(np.uint8).reshape(-1, 4).T))
    return found
