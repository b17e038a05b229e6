"""Draws a picture as pixels, by kitty's graphics protocol or as DEC sixels."""

from __future__ import annotations

import base64
import re
import zlib

import numpy as np
import numpy.typing as npt
from PIL import Image

__all__ = ["Kitty", "Pixels", "Sixel"]

U8 = npt.NDArray[np.uint8]
CHUNK = 4096  # bytes of base64, as the protocol demands
COLOURS = 256  # registers that terminals have
MAX_SIZE = (1600, 1200)  # pixels that are sent


class Pixels:
    """Base class of drawing by pixels. cell: width and height of a character cell in pixels."""

    def __init__(self, cell: tuple[int, int]) -> None:
        self.cell = cell

    def size_in_pixels(self, columns: int, rows: int) -> tuple[int, int]:
        """Returns the size in pixels, (width, height), of an area of this many cells."""
        return min(columns * self.cell[0], MAX_SIZE[0]), min(rows * self.cell[1], MAX_SIZE[1])

    def cells(self, size: tuple[int, int]) -> tuple[int, int]:
        """Returns the number of columns and rows that a picture of this size in pixels covers."""
        return -(-size[0] // self.cell[0]), -(-size[1] // self.cell[1])

    def discard_drawn(self) -> None:
        """Resets the record of the drawn picture, since the screen was cleared."""

    def clearing_bytes(self) -> bytes:
        """Returns the bytes that delete graphics which remain after the screen is cleared."""
        return b""


class Kitty(Pixels):
    """Draws by kitty's graphics protocol. Alternates two images, so that the old one is deleted once the new one is shown.

    Source: https://sw.kovidgoyal.net/kitty/graphics-protocol/
    """

    name = "kitty graphics"
    FIRST = 7261  # an image's number, which other programs are unlikely to have

    def __init__(self, cell: tuple[int, int]) -> None:
        super().__init__(cell)
        self._turn = 0

    def draw(self, picture: U8, column: int, row: int) -> bytes:
        """Returns the bytes that draw a picture (h, w, 3) with its upper left corner in the given cell, counted from 1."""
        old, self._turn = self.FIRST + self._turn, 1 - self._turn
        data = base64.b64encode(zlib.compress(np.ascontiguousarray(picture).tobytes(), 1))
        pieces = [data[at : at + CHUNK] for at in range(0, len(data), CHUNK)]
        height, width = picture.shape[:2]
        head = f"a=T,f=24,o=z,s={width},v={height},i={self.FIRST + self._turn},C=1,q=2,"
        out = [b"\x1b[%d;%dH" % (row, column)]
        for number, piece in enumerate(pieces):
            more = number < len(pieces) - 1
            out.append(b"\x1b_G%sm=%d;%s\x1b\\" % ((head if number == 0 else "").encode(), more, piece))
        return b"".join([*out, _delete_image_command(old)])

    def clearing_bytes(self) -> bytes:
        """Returns the bytes that delete both images of kitty's graphics, which remain after the screen is cleared."""
        return _delete_image_command(self.FIRST) + _delete_image_command(self.FIRST + 1)


def _delete_image_command(image: int) -> bytes:
    return b"\x1b_Ga=d,d=I,i=%d,q=2\x1b\\" % image


class Sixel(Pixels):
    """Draws sixels: bands of six rows, one colour after another.

    Source: VT330/VT340 Programmer Reference Manual, volume 2, chapter 14.
    """

    name = "sixels"

    def draw(self, picture: U8, column: int, row: int) -> bytes:
        """Returns the bytes that draw a picture (h, w, 3) with its upper left corner in the given cell, counted from 1."""
        reduced = Image.fromarray(np.ascontiguousarray(picture)).quantize(COLOURS, Image.Quantize.MEDIANCUT)
        palette = np.array(reduced.getpalette(), int).reshape(-1, 3)
        numbers = np.asarray(reduced)
        height, width = numbers.shape
        out = [b'\x1b[%d;%dH\x1bP0;1q"1;1;%d;%d' % (row, column, width, height)]
        for number, (r, g, b) in enumerate((palette * 100 + 127) // 255):
            out.append(b"#%d;2;%d;%d;%d" % (number, r, g, b))
        bands = b"-".join(_encode_band(numbers[top : top + 6]) for top in range(0, height, 6))
        return b"".join([*out, bands, b"\x1b\\"])


def _encode_band(numbers: U8) -> bytes:
    """Encodes up to six rows of colour numbers: for each colour, the pixels that have it."""
    bits = 1 << np.arange(len(numbers))
    lines = []
    for colour in np.unique(numbers):
        sixels = (63 + bits @ (numbers == colour)).astype(np.uint8).tobytes()
        lines.append(b"#%d%s" % (colour, re.sub(rb"(.)\1{3,}", lambda run: b"!%d%s" % (len(run[0]), run[1]), sixels)))
    return b"$".join(lines)
