"""Somebody who looks at a scene: what is to be seen, the pictures so far, and what the page is told about them.

The desk's thread fills it, and the event loop's threads take pictures out. A lock between them is held while sums are read or
added.
"""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from renderer.film import Sums
from renderer.settings import RenderSettings
from service.viewing.canvas import Canvas
from service.viewing.look import Look
from service.viewing.passes import Passes, Piece, levels_of
from service.viewing.view_packet import Shown, packet

__all__ = ["Watch"]

SHOW_EVERY_S = 0.25  # while a picture is not complete at its number of samples
SHOW_SELDOM_S = 2.0  # where a view has been looked at for long: less changes from second to second
HOLD_S = 0.5  # that a view which has no picture yet goes on though a newer one is wanted: else a moving hand would see none


class Watch:
    """Made by whoever looks, and given to the desk."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """wake: called from the desk's thread when there is something to tell or to show."""
        self.id = uuid.uuid4().hex[:16]
        self.wake = wake
        self.is_paused = False
        self.is_closed = False
        self.wanted: Look | None = None
        self.look: Look | None = None  # the one that is rendered
        self.view = 0  # its number
        self.kind = ""
        self.compiled = ""
        self.settings: RenderSettings | None = None  # None until its moment is prepared
        self.message: str | None = None  # why there is nothing new
        self.error: str | None = None
        self.slots = 0
        self.picked: list[dict[str, Any]] = []  # for the page
        self.pick: tuple[int, int] | None = None
        self.passes: Passes | None = None
        self.begun = 0.0
        self.has_picture = False  # of this view
        self.served = 0  # when it was given work last, as a place in the order of all messages
        self._lock = threading.Lock()
        self._canvases: list[Canvas] = []
        self._shown = -1  # the level of the picture that was taken last
        self._shown_samples = 0
        self._taken = 0.0

    @property
    def is_ready_for_next(self) -> bool:
        """Whether the view that is wanted may take the place of the one that is rendered."""
        if self.wanted is None:
            return False
        is_over = self.look is None or self.has_picture or self.error is not None or self.message is not None
        return is_over or time.monotonic() - self.begun > HOLD_S

    def turn_to(self, look: Look, view: int) -> None:
        """Another view from now on. What was rendered for the last one is forgotten."""
        with self._lock:
            self.look, self.view, self.wanted = look, view, None
            self.settings, self.passes = None, None
            self.message = self.error = None
            self.begun, self.has_picture = time.monotonic(), False
            self._canvases, self._shown, self._shown_samples = [], -1, 0

    def forget(self) -> None:
        """Nobody looks any more. Its pictures go now, whoever still refers to it."""
        with self._lock:
            self.settings, self.passes, self._canvases = None, None, []

    @property
    def pixels(self) -> int:
        """Of the picture that lies in memory."""
        return self.settings.width * self.settings.height if self.settings else 0

    def begin_again(self) -> None:
        """What is rendered so far is of workers that are gone."""
        if self.look is not None:
            wanted = self.wanted
            self.turn_to(self.look, self.view)
            self.wanted = wanted

    def begin(self, settings: RenderSettings, compiled: str, kind: str, cost_s: float, slots: int) -> None:
        """It is known what to render."""
        assert self.look is not None
        levels = levels_of(settings.width, settings.height, self.look.samples, cost_s, max(slots, 1))
        with self._lock:
            self.settings, self.compiled, self.kind = settings, compiled, kind
            self.passes = Passes(levels, cost_s)
            self._canvases = [Canvas(level, settings.film_exponent, self.look.noise) for level in levels]

    def settings_of(self, level: int) -> RenderSettings:
        """What the pieces of a level are rendered with."""
        assert self.settings is not None
        assert self.passes is not None
        of = self.passes.levels[level]
        return replace(self.settings, width=of.width, height=of.height)

    def add(self, piece: Piece, sums: Sums) -> None:
        """A piece is rendered."""
        with self._lock:
            canvas = self._canvases[piece.level]
            if canvas.tile_is_complete(piece.tile):  # it was on its way when the tile had come to its noise
                return
            canvas.add(piece.tile, piece.first, piece.count, sums)
            self.has_picture = self.has_picture or canvas.samples > 0
        if self.passes is not None and canvas.tile_is_complete(piece.tile):
            self.passes.end(piece.level, piece.tile)

    @property
    def samples(self) -> int:
        """Of the whole view, what every pixel has at least."""
        with self._lock:
            return self._canvases[-1].samples if self._canvases else 0

    @property
    def mean_samples(self) -> float:
        """Of the whole view, what a pixel has on the average."""
        with self._lock:
            return self._canvases[-1].mean_samples if self._canvases else 0.0

    @property
    def noise(self) -> float | None:
        """The whole view's, relative; None while it is not known."""
        with self._lock:
            return self._canvases[-1].noise if self._canvases else None

    @property
    def is_done(self) -> bool:
        """Whether it has as many samples, or as little noise, as is wanted."""
        with self._lock:
            return bool(self._canvases) and self._canvases[-1].is_complete

    @property
    def bound(self) -> int:
        """With how many samples it is done."""
        return self.look.samples if self.look else 0

    def is_due(self) -> bool:
        """Whether there is a picture to be shown now."""
        with self._lock:
            return self._due() is not None

    def take(self, seq: int) -> bytes | None:
        """What has changed of the picture that is to be shown now, as a message; None: nothing is due."""
        with self._lock:
            level = self._due()
            if level is None or self.look is None:
                return None
            canvas, look = self._canvases[level], self.look
            if level != self._shown:
                self._shown = level
                for lower in self._canvases[:level]:
                    lower.changed.clear()
            self._shown_samples, self._taken = canvas.samples, time.monotonic()
            is_whole = level == len(self._canvases) - 1
            tiles = [(canvas.level.tiles[tile], *canvas.take(tile)) for tile in list(canvas.changed)]
        shown = [Shown(rect, mean, samples, is_whole and is_complete) for rect, mean, samples, is_complete in tiles]
        size, whole = (canvas.level.width, canvas.level.height), (look.settings.width, look.settings.height)
        return packet(shown, size, whole, look.id, seq)

    def _due(self) -> int | None:
        """The level whose picture is to be shown now."""
        for level in range(len(self._canvases) - 1, max(self._shown, 0) - 1, -1):
            canvas = self._canvases[level]
            if not canvas.changed:
                continue
            at_least = 2 * self._shown_samples if level == self._shown else 1
            if canvas.samples >= max(at_least, 1) or canvas.is_complete:
                return level
            may_be_mixed = level == self._shown or (level == len(self._canvases) - 1 and self._shown >= 0)
            now = time.monotonic()
            if may_be_mixed and now - self._taken >= min(max(SHOW_EVERY_S, 0.05 * (now - self.begun)), SHOW_SELDOM_S):
                return level
        return None
