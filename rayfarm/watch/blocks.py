"""Draws a picture with half blocks: each character cell shows two pixels, one above the other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Blocks", "nearest_256"]

U8 = npt.NDArray[np.uint8]
UPPER = "▀"
CUBE = np.array([0, 95, 135, 175, 215, 255])  # xterm's colours 16 to 231, by red, green and blue


def nearest_256(rgb: U8) -> npt.NDArray[np.int_]:
    """Returns the nearest of xterm's 256 colours (from its cube and greys) to each colour: (..., 3) uint8 to (...)."""
    values = rgb.astype(int)
    steps = np.abs(values[..., None] - CUBE).argmin(axis=-1)
    grey = np.clip((values.mean(axis=-1) - 3).astype(int) // 10, 0, 23)  # 232 to 255 are 8, 18 ... 238
    of_cube = ((CUBE[steps] - values) ** 2).sum(axis=-1)
    of_grey = ((8 + 10 * grey[..., None] - values) ** 2).sum(axis=-1)
    return np.where(of_grey < of_cube, 232 + grey, 16 + steps @ np.array([36, 6, 1]))


class Blocks:
    """Draws pictures with half blocks. Skips rows that have not changed."""

    name = "half blocks"

    def __init__(self, is_true_colour: bool) -> None:
        """Creates an empty drawing.

        is_true_colour: whether the terminal supports 24-bit colours; otherwise xterm's 256 are used.
        """
        self._is_true_colour = is_true_colour
        self._rows: dict[int, str] = {}

    def size_in_pixels(self, columns: int, rows: int) -> tuple[int, int]:
        """Returns the size in pixels, (width, height), of an area of this many cells."""
        return columns, 2 * rows

    def cells(self, size: tuple[int, int]) -> tuple[int, int]:
        """Returns the number of columns and rows that a picture of this size in pixels covers."""
        return size[0], (size[1] + 1) // 2

    def discard_drawn(self) -> None:
        """Forgets which picture is on the screen, so that the next one is drawn completely.

        Called after the screen was cleared.
        """
        self._rows.clear()

    def draw(self, picture: U8, column: int, row: int) -> bytes:
        """Returns the bytes that draw a picture (h, w, 3) with its upper left corner in the given cell, counted from 1."""
        if picture.shape[0] % 2:
            picture = np.concatenate([picture, np.zeros_like(picture[:1])])
        colours = self._colours(picture)
        out = []
        for y, (above, below) in enumerate(zip(colours[::2], colours[1::2], strict=True)):
            text = f"\x1b[{row + y};{column}H{self._row(above, below)}\x1b[m"
            if self._rows.get(row + y) != text:
                self._rows[row + y] = text
                out.append(text)
        return "".join(out).encode()

    def clearing_bytes(self) -> bytes:
        """Returns the bytes that delete graphics which remain after the screen is cleared: none for half blocks."""
        return b""

    def _colours(self, picture: U8) -> list[list[int]]:
        if self._is_true_colour:
            found: list[list[int]] = (picture.astype(int) @ np.array([1 << 16, 1 << 8, 1])).tolist()
            return found
        return [[int(number) for number in row] for row in nearest_256(picture)]

    def _row(self, above: list[int], below: list[int]) -> str:
        parts, fore, back = [], -1, -1
        for upper, lower in zip(above, below, strict=True):
            codes = []
            if upper != fore:
                codes.append(self._code(38, upper))
            if lower != back:
                codes.append(self._code(48, lower))
            fore, back = upper, lower
            parts.append(f"\x1b[{';'.join(codes)}m{UPPER}" if codes else UPPER)
        return "".join(parts)

    def _code(self, color: int, colour: int) -> str:
        if self._is_true_colour:
            return f"{color};2;{colour >> 16};{colour >> 8 & 255};{colour & 255}"
        return f"{color};5;{colour}"
