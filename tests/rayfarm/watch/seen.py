"""A terminal emulator for tests that interprets only the escape sequences used by `rayfarm watch`."""

from __future__ import annotations

import base64
import codecs
import re
import zlib

import numpy as np

__all__ = ["Seen", "colour_256"]

ORDERS = re.compile(
    r"\x1b_G(?P<kitty>[^\x1b]*)\x1b\\|\x1bP(?P<dcs>[^\x1b]*)\x1b\\|\x1b\[(?P<arguments>[?\d;]*)(?P<order>[A-Za-z])|(?P<text>[^\x1b])",
    re.S,
)


class Seen:
    """A screen of character cells. pixels: the latest picture shown by half blocks, kitty's graphics or sixels."""

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self.text = np.full((rows, columns), " ")
        self.colours = np.zeros((2 * rows, columns, 3), np.uint8)
        self.images: dict[int, np.ndarray] = {}  # images in kitty's protocol, by id
        self.sixel: np.ndarray | None = None
        self.modes: set[str] = set()
        self.drawn: list[tuple[int, int]] = []  # cells that contain a half block
        self._fore = self._back = np.zeros(3, np.uint8)
        self._at = [0, 0]
        self._kitty: tuple[dict[str, str], str] = ({}, "")
        self._rest = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")()

    def take(self, data: bytes) -> None:
        """Processes the program's output."""
        text = self._rest + self._decoder.decode(data)
        end = 0
        for found in ORDERS.finditer(text):
            if found.start() != end:
                break
            end = found.end()
            if (char := found["text"]) is not None:
                self._write(char)
            elif found["kitty"] is not None:
                self._graphics(found["kitty"])
            elif found["dcs"] is not None:
                if "q" in found["dcs"] and not found["dcs"].startswith("$"):
                    self.sixel = _sixels(found["dcs"])
            else:
                self._order(found["arguments"], found["order"])
        self._rest = text[end:]

    def lines(self) -> list[str]:
        """Returns the displayed text, row by row."""
        return ["".join(row).rstrip() for row in self.text]

    def blocks(self) -> np.ndarray:
        """Returns the pixels (h, w, 3) of the picture drawn with half blocks."""
        rows, columns = np.nonzero(self.text == "▀")
        if not len(rows):
            return np.zeros((0, 0, 3), np.uint8)
        return self.colours[2 * rows.min() : 2 * rows.max() + 2, columns.min() : columns.max() + 1]

    def _write(self, char: str) -> None:
        row, column = self._at
        if char in "\r\n":
            return
        if row < self.rows and column < self.columns:
            self.text[row, column] = char
            if char == "▀":
                self.drawn.append((row, column))
                self.colours[2 * row, column], self.colours[2 * row + 1, column] = self._fore, self._back
        self._at[1] += 1

    def _order(self, arguments: str, order: str) -> None:
        numbers = [int(number or 0) for number in arguments.lstrip("?").split(";")]
        if order == "H":
            self._at = [(numbers[0] or 1) - 1, (numbers[1] if len(numbers) > 1 else 1) - 1]
        elif order == "J":
            self.text[:], self.colours[:] = " ", 0
        elif order in "hl" and arguments.startswith("?"):
            (self.modes.add if order == "h" else self.modes.discard)(arguments[1:])
        elif order == "m":
            while numbers:
                which = numbers.pop(0)
                if which in (38, 48):
                    way = numbers.pop(0)
                    colour = np.array([numbers.pop(0) for _ in range(3)]) if way == 2 else colour_256(numbers.pop(0))
                    self._fore, self._back = (colour, self._back) if which == 38 else (self._fore, colour)

    def _graphics(self, packet: str) -> None:
        head, _, data = packet.partition(";")
        keys = dict(pair.split("=") for pair in head.split(","))
        if keys.get("a") == "d":
            self.images.pop(int(keys["i"]), None)
        elif keys.get("a") in ("T", None):
            assert len(data) <= 4096
            first, before = self._kitty if "a" not in keys else (keys, "")
            self._kitty = first, before + data
            if keys["m"] == "0":
                raw = zlib.decompress(base64.b64decode(before + data))
                self.images[int(first["i"])] = np.frombuffer(raw, np.uint8).reshape(int(first["v"]), int(first["s"]), 3)


def colour_256(number: int) -> np.ndarray:
    """Returns red, green and blue of one of xterm's colours beyond the first 16."""
    if number >= 232:
        return np.full(3, 8 + 10 * (number - 232))
    cube = [0, 95, 135, 175, 215, 255]
    return np.array([cube[(number - 16) // 36], cube[(number - 16) // 6 % 6], cube[(number - 16) % 6]])


def _sixels(text: str) -> np.ndarray:
    _, _, width, height = map(int, re.search(r'"(\d+);(\d+);(\d+);(\d+)', text).groups())  # type: ignore[union-attr]
    picture, palette = np.zeros((height + 5, width, 3), np.uint8), {}
    x = y = colour = 0
    body = text[text.index('"') :]
    body = body[re.match(r'"[\d;]*', body).end() :]  # type: ignore[union-attr]
    for found in re.finditer(r"#(\d+)(?:;2;(\d+);(\d+);(\d+))?|!(\d+)([?-~])|([?-~])|(\$)|(-)", body):
        if found[1] is not None:
            colour = int(found[1])
            if found[2] is not None:
                palette[colour] = np.array([int(found[i]) * 255 / 100 for i in (2, 3, 4)]).round()
        elif found[8]:
            x = 0
        elif found[9]:
            x, y = 0, y + 6
        else:
            count, char = (int(found[5]), found[6]) if found[5] else (1, found[7])
            for bit in range(6):
                if ord(char) - 63 >> bit & 1:
                    picture[y + bit, x : x + count] = palette[colour]
            x += count
    return picture[:height]
