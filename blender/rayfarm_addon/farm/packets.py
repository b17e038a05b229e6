"""Decodes the farm's picture packets to arrays: (h, w, 4) float32 linear, rows from the bottom as in Blender's images.

docs/api.md describes the layouts: live tiles and films under "Live", views under "A scene in the hand".
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Film", "Tile", "View", "Words", "film", "rgba", "tile", "unpacked"]

F32 = npt.NDArray[np.float32]
Words = npt.NDArray[np.uint32]
TILE = struct.Struct("<BBHIHHHHI")
FILM = struct.Struct("<BBHHHI")
VIEW = struct.Struct("<BBHIIHHHH")
VIEW_TILE = struct.Struct("<HHHHI")
EXACT = 1 << 31
RAW = -15


class Tile(NamedTuple):
    """A tile of a frame; x and y from the upper left corner."""

    seq: int
    x: int
    y: int
    samples: int
    words: Words  # (h, w) RGB9E5, rows from the top


class Film(NamedTuple):
    """A frame's accumulated light. samples: sample count of each tile of size `side`, in reading order."""

    side: int
    samples: npt.NDArray[np.uint32]
    words: Words  # (h, w)


def unpacked(words: Words) -> F32:
    """Returns the radiance, (..., 3), of RGB9E5 words: mantissa times 2**(exponent - 24)."""
    found = np.stack([words & 511, words >> 9 & 511, words >> 18 & 511], axis=-1).astype(np.float32)
    step = (((words >> 27).astype(np.int32) + (127 - 24)) << 23).view(np.float32)
    return np.asarray(found * step[..., None], np.float32)


def rgba(rgb: F32) -> F32:
    """Converts (h, w, 3) with rows from the top to Blender's order: opaque RGBA, rows from the bottom."""
    found = np.ones((*rgb.shape[:2], 4), np.float32)
    found[..., :3] = rgb[::-1]
    return found


def tile(packet: bytes) -> Tile:
    """Decodes a message of a job's live channel. Raises ValueError."""
    if len(packet) < TILE.size:
        raise ValueError("a tile is cut off")
    version, kind, _, seq, x, y, w, h, samples = TILE.unpack_from(packet)
    if (version, kind) != (1, 1) or len(packet) != TILE.size + 4 * w * h:
        raise ValueError("a tile is of another release")
    return Tile(seq, x, y, samples, np.frombuffer(packet, "<u4", w * h, TILE.size).reshape(h, w))


def film(packet: bytes) -> Film:
    """Decodes the response of /film. Raises ValueError."""
    version, kind, _, w, h, side = FILM.unpack_from(packet)
    if (version, kind) != (1, 2):
        raise ValueError("a film is of another release")
    count = -(-w // side) * -(-h // side)
    samples = np.frombuffer(packet, "<u4", count, FILM.size)
    planes = np.frombuffer(packet, np.uint8, 4 * w * h, FILM.size + 4 * count)
    return Film(side, samples, _words(planes, w * h).reshape(h, w))


def _words(planes: npt.NDArray[np.uint8], count: int) -> Words:
    return np.ascontiguousarray(planes.reshape(4, count).T).view("<u4").reshape(count).astype(np.uint32)


class View:
    """A progressive view, built from the packets of a viewport's channel. `rgb` is (h, w, 3), rows from the top."""

    def __init__(self) -> None:
        self.id = -1
        self.seq = 0
        self.rgb: F32 = np.zeros((0, 0, 3), np.float32)
        self.whole = (0, 0)

    def take(self, packet: bytes) -> None:
        """Adds a packet; one of another view or size replaces the picture. Raises ValueError."""
        version, kind, count, id, self.seq, w, h, *whole = VIEW.unpack_from(packet)
        if (version, kind) != (2, 3):
            raise ValueError("the view is of another release")
        tiles = [VIEW_TILE.unpack_from(packet, VIEW.size + i * VIEW_TILE.size) for i in range(count)]
        body = zlib.decompressobj(RAW).decompress(packet[VIEW.size + count * VIEW_TILE.size :])
        if id != self.id or self.rgb.shape[:2] != (h, w):
            old, self.rgb = self.rgb, np.zeros((h, w, 3), np.float32)
            if old.size:
                self.rgb[:] = _stretched(old, w, h)
        self.id, self.whole = id, (whole[0], whole[1])
        at = self._take_coarse([t for t in tiles if not t[4] & EXACT], body)
        exact = [t for t in tiles if t[4] & EXACT]
        words = _words(np.frombuffer(body, np.uint8, offset=at), sum(t[2] * t[3] for t in exact)) if exact else None
        first = 0
        for x, y, tw, th, _ in exact:
            assert words is not None
            self.rgb[y : y + th, x : x + tw] = unpacked(words[first : first + tw * th]).reshape(th, tw, 3)
            first += tw * th

    def _take_coarse(self, tiles: list[Any], body: bytes) -> int:
        """Adds the tiles of a coarse picture; returns the number of bytes read."""
        if not tiles:
            return 0
        pixels = sum(t[2] * t[3] for t in tiles)
        fours = sum(-(-t[2] // 2) * -(-t[3] // 2) for t in tiles)
        planes = np.frombuffer(body, np.uint8, 2 * pixels + 2 * fours)
        folded = planes[:pixels].astype(np.uint16) | planes[pixels : 2 * pixels].astype(np.uint16) << 8
        more = ((folded >> 1) ^ -(folded & 1).astype(np.int32)).astype(np.int32)
        codes = np.cumsum(more, dtype=np.int32)
        # code = 1 + 32 (e + 24) + m stands for 2**e (1 + m / 32): e and m as a float has them, side by side
        bright = np.where(codes > 0, ((codes + ((127 - 24) << 5) - 1) << 18).astype(np.int32).view(np.float32), np.float32(0))
        red, green = (
            np.cumsum(planes[2 * pixels + i * fours : 2 * pixels + (i + 1) * fours], dtype=np.uint8).astype(np.float32) / 255
            for i in (0, 1)
        )
        first = of_four = 0
        for x, y, w, h, _ in tiles:
            half, rows = -(-w // 2), -(-h // 2)
            b = bright[first : first + w * h].reshape(h, w)
            r, g = (
                np.repeat(np.repeat(hue[of_four : of_four + half * rows].reshape(rows, half), 2, 0), 2, 1)[:h, :w]
                for hue in (red, green)
            )
            self.rgb[y : y + h, x : x + w] = np.stack([b * r, b * g, b * np.maximum(1 - r - g, 0)], axis=-1)
            first, of_four = first + w * h, of_four + half * rows
        return 2 * pixels + 2 * fours


def _stretched(rgb: F32, w: int, h: int) -> F32:
    rows = np.arange(h) * rgb.shape[0] // h
    columns = np.arange(w) * rgb.shape[1] // w
    return np.asarray(rgb[rows][:, columns], np.float32)
