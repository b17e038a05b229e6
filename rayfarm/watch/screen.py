"""Shows a job on the terminal's screen: its picture and state; handles keys."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np
import numpy.typing as npt

from rayfarm.client import Client, ClientError
from rayfarm.watch.blocks import Blocks
from rayfarm.watch.fit import fitted_picture, fitted_size
from rayfarm.watch.live import LiveJob
from rayfarm.watch.pixels import Kitty, Sixel
from rayfarm.watch.terminal import Abilities, Terminal
from rayfarm.watch.words import fit_columns, frame_title, progress_text
from renderer.image.tonemap import CURVES

__all__ = ["GRAPHICS", "Graphics", "Screen", "drawing_surface"]

Graphics = Literal["auto", "kitty", "sixel", "blocks"]
GRAPHICS: tuple[Graphics, ...] = ("auto", "kitty", "sixel", "blocks")
EXPOSURE_STEP = 0.5
EXPOSURE_MOST = 20.0
TEXT_EVERY_S = 0.25
DRAW_EVERY_S = 0.1
DRAWING_PAUSE_FACTOR = 2.0  # times as long as drawing took, nothing is drawn: the terminal may be far away
LINES = 3  # beneath the picture
KEYS = "q quit · +/- exposure · 0 reset · t curve · c cancel"


def drawing_surface(graphics: Graphics, abilities: Abilities) -> Blocks | Kitty | Sixel:
    """Returns the drawing object for a terminal: by pixels if the terminal supports it, otherwise half blocks."""
    if graphics == "kitty" or (graphics == "auto" and abilities.kitty):
        return Kitty(abilities.cell)
    if graphics == "sixel" or (graphics == "auto" and abilities.sixel):
        return Sixel(abilities.cell)
    return Blocks(abilities.true_colour)


class Screen:
    """Draws a job on the screen until the user quits."""

    def __init__(self, terminal: Terminal, farm: Client, live: LiveJob, graphics: Graphics, exposure: float, curve: str) -> None:
        self._terminal = terminal
        self._farm = farm
        self._live = live
        self._surface = drawing_surface(graphics, terminal.abilities())
        self._exposure = exposure
        self._curve = curve
        self._asks = False  # whether to cancel
        self._error: str | None = None  # error message after a key press
        self._is_dirty = True
        self._not_before = 0.0
        self._spoke: list[str] = []
        self._changes = -1
        self._shape: tuple[int, ...] = ()

    def run(self) -> int | None:
        """Draws until q is pressed, the job is gone, or a signal arrives. Returns the signal, or None without one.

        Raises ClientError if the job cannot be watched.
        """
        try:
            while self._terminal.ended is None:
                if self._live.error is not None:
                    raise self._live.error
                self._draw()
                wait_s = max(self._not_before - time.monotonic(), 0.0) if self._is_dirty else TEXT_EVERY_S
                for key in self._terminal.keys(wait_s):
                    if self._handle_key(key):
                        return None
            return self._terminal.ended
        finally:
            self._terminal.write(self._surface.clearing_bytes())

    def _handle_key(self, key: str) -> bool:
        self._error = None
        if self._asks:
            self._asks = False
            if key in "yY":
                self._cancel()
            return False
        match key:
            case "q" | "Q":
                return True
            case "+" | "=":
                self._set_exposure(self._exposure + EXPOSURE_STEP)
            case "-" | "_":
                self._set_exposure(self._exposure - EXPOSURE_STEP)
            case "0":
                self._set_exposure(0.0)
            case "t":
                self._curve = CURVES[(CURVES.index(self._curve) + 1) % len(CURVES)]
                self._is_dirty = True
            case "c":
                self._asks = not self._live.job.is_over
            case "left" | "right":
                self._change_frame(1 if key == "right" else -1)
        return False

    def _set_exposure(self, stops: float) -> None:
        self._exposure = min(max(stops, -EXPOSURE_MOST), EXPOSURE_MOST)
        self._is_dirty = True

    def _change_frame(self, step: int) -> None:
        numbers = sorted(self._live.frames)
        if self._live.job.shot is None or not numbers:
            return
        at = min(range(len(numbers)), key=lambda i: abs(numbers[i] - self._live.frame))
        self._live.follows = False
        self._live.watch_frame(numbers[(at + step) % len(numbers)])

    def _cancel(self) -> None:
        try:
            self._farm.change(self._live.job.id, state="cancelled")
        except ClientError as error:
            self._error = str(error)

    def _draw(self) -> None:
        if self._live.changes != self._changes:
            self._is_dirty, self._changes = True, self._live.changes
        columns, rows = self._terminal.size()
        film = self._live.versions()[1] if self._is_dirty else None
        data = b""
        if self._terminal.resized or (film is not None and film.shape != self._shape):
            self._terminal.resized = False
            self._surface.discard_drawn()
            self._spoke = []
            self._is_dirty, self._not_before = True, 0.0
            data = self._surface.clearing_bytes() + b"\x1b[m\x1b[2J"
        begun = time.monotonic()
        draws = self._is_dirty and begun >= self._not_before
        if draws:
            self._is_dirty = False
            data += self._picture(self._live.versions()[1], columns, rows - LINES)
        data += self._text_bytes(columns, rows)
        if data:
            self._terminal.draw(data)
        if draws:
            now = time.monotonic()
            self._not_before = now + max(DRAW_EVERY_S, DRAWING_PAUSE_FACTOR * (now - begun))

    def _picture(self, film: npt.NDArray[np.float32] | None, columns: int, rows: int) -> bytes:
        if film is None or rows < 1:
            return b""
        self._shape = film.shape
        size = fitted_size((film.shape[1], film.shape[0]), self._surface.size_in_pixels(columns, rows))
        wide, high = self._surface.cells(size)
        picture = fitted_picture(film, size, self._exposure, self._curve)
        return self._surface.draw(picture, (columns - wide) // 2 + 1, max((rows - high) // 2, 0) + 1)

    def _text_bytes(self, columns: int, rows: int) -> bytes:
        """Returns the bytes that draw the changed lines of text below the picture."""
        job = self._live.job
        if self._asks:
            keys = "Cancel this job? What is rendered is kept.  y yes · any other key no"
        else:
            look = f"exposure {self._exposure:+g} · {self._curve}"
            turn = " · ←/→ frame" if job.shot is not None else ""
            keys = self._error or f"{KEYS}{turn} · {look}"
        lines = [
            fit_columns(self._live.trouble or job.error or progress_text(job, with_bar=columns >= 60), columns),
            fit_columns(frame_title(job, self._live.watched_frame), columns),
            fit_columns(keys, columns),
        ][-rows:]
        if lines == self._spoke:
            return b""
        self._spoke = lines
        out = []
        for number, (line, style) in enumerate(zip(lines, ("1", "", "2")[-len(lines) :], strict=True)):
            out.append(f"\x1b[{rows - len(lines) + 1 + number};1H\x1b[{style}m{line}\x1b[m")
        return "".join(out).encode()
