"""A view's picture on the wire, little-endian:

u8 version = 1, u8 kind = 3, u16 tiles, u32 id (as the page named the view, modulo 2**32), u32 seq, u16 width, u16 height (of this
picture), u16 width, u16 height (of the view when it is whole), then of each tile u16 x, y, w, h and u32 samples a pixel, and then
their RGB9E5 words one tile behind the other, rows from the top.
"""

from __future__ import annotations

import struct

from service.viewing.canvas import Canvas

__all__ = ["HEADER", "KIND_VIEW", "TILE", "VERSION", "packet"]

VERSION = 1
KIND_VIEW = 3
HEADER = struct.Struct("<BBHIIHHHH")
TILE = struct.Struct("<HHHHI")


def packet(canvas: Canvas, tiles: list[int], id: int, seq: int, size: tuple[int, int]) -> bytes:
    """The whole message. size: of the view when it is whole."""
    level = canvas.level
    parts = [
        HEADER.pack(VERSION, KIND_VIEW, len(tiles), id & 0xFFFFFFFF, seq & 0xFFFFFFFF, level.width, level.height, *size),
        *(TILE.pack(*level.tiles[tile], canvas.counts[tile]) for tile in tiles),
        *(canvas.words(tile) for tile in tiles),
    ]
    return b"".join(parts)
