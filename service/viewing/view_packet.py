"""The packet of a view's picture, little-endian.

u8 version = 2, u8 kind = 3, u16 number of tiles, u32 id (the page's number of the view, modulo 2**32), u32 seq, u16 width, u16
height (of this picture), u16 width, u16 height (of the whole view); per tile u16 x, y, w, h and u32 samples per pixel, whose
highest bit marks the tile as exact; then, compressed with raw DEFLATE:

all tiles that are not exact, rows from the top, one tile after the other: differences of brightness codes
(service/viewing/coarse.py) in zigzag encoding (0, -1, 1, -2 ... as 0, 1, 2, 3 ...), first all low bytes, then all high bytes;
then differences of the shares of red, and of green, modulo 256;

all exact tiles as RGB9E5 words in four byte planes, the lowest byte first.
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
RAW = -15  # zlib's wbits for raw DEFLATE
LEVEL = 1  # noise: higher levels take longer and save nothing


class Shown(NamedTuple):
    """A tile of a picture."""

    rect: Tile
    mean: npt.NDArray[np.float32]  # (3, h, w)
    samples: int
    is_exact: bool


def packet(tiles: list[Shown], size: tuple[int, int], whole: tuple[int, int], id: int, seq: int) -> bytes:
    """Encodes a packet. size: of this picture; whole: of the whole view, both (width, height)."""
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
