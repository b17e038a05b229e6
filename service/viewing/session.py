"""Session of a live view: the requested view, its pictures so far, and the messages to the page.

The scheduler's thread adds sums; threads of the event loop read pictures. A lock protects the sums.
"""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import replace

from protocol.pictures import ViewTile, encode_view
from protocol.viewport import Picked
from renderer.film import Sums
from renderer.settings import RenderSettings
from service.viewing.canvas import Canvas
from service.viewing.passes import Passes, Piece, levels_of
from service.viewing.view_request import ViewRequest

__all__ = ["ViewSession"]

SHOW_EVERY_S = 0.25  # while a picture is incomplete
SHOW_CONVERGED_S = 2.0  # for a view that has been shown for long and changes slowly
MIN_PICTURE_WAIT_S = 0.5  # a view without a picture is replaced only after this time, so that dragging shows pictures


class ViewSession:
    """State of a live view that a page shows over one WebSocket. The route creates it and passes it to the view scheduler."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """Creates a session without a view.

        wake: called in the scheduler's thread when there is a message or a picture to send.
        """
        self.id = uuid.uuid4().hex[:16]
        self.wake = wake
        self.is_paused = False
        self.is_closed = False
        self.wanted: ViewRequest | None = None
        self.request: ViewRequest | None = None  # being rendered
        self.view = 0  # number of the view
        self.kind = ""
        self.compiled = ""
        self.settings: RenderSettings | None = None  # None until the frame is prepared
        self.message: str | None = None  # reason for the lack of new pictures
        self.error: str | None = None
        self.slots = 0
        self.picked: list[Picked] = []  # for the page
        self.pick: tuple[int, int] | None = None
        self.passes: Passes | None = None
        self.begun = 0.0
        self.has_picture = False  # of this view
        self.served = 0  # sequence number of its latest message
        self._lock = threading.Lock()
        self._canvases: list[Canvas] = []
        self._shown = -1  # level of the latest picture taken
        self._shown_samples = 0
        self._taken = 0.0

    @property
    def is_ready_for_next(self) -> bool:
        """Returns True if the requested view may replace the current one now.

        That is so once the current view has shown a picture, an error or a message, or has run for MIN_PICTURE_WAIT_S seconds.
        """
        if self.wanted is None:
            return False
        is_over = self.request is None or self.has_picture or self.error is not None or self.message is not None
        return is_over or time.monotonic() - self.begun > MIN_PICTURE_WAIT_S

    def switch_to(self, request: ViewRequest, view: int) -> None:
        """Replaces the current view by a requested one, and discards its pictures. view: number of the new view."""
        with self._lock:
            self.request, self.view, self.wanted = request, view, None
            self.settings, self.passes = None, None
            self.message = self.error = None
            self.begun, self.has_picture = time.monotonic(), False
            self._canvases, self._shown, self._shown_samples = [], -1, 0

    def free_pictures(self) -> None:
        """Frees the pictures of a closed session at once, although other objects may still refer to the session."""
        with self._lock:
            self.settings, self.passes, self._canvases = None, None, []

    @property
    def pixels(self) -> int:
        """Number of pixels of the picture that is held in memory."""
        return self.settings.width * self.settings.height if self.settings else 0

    def restart(self) -> None:
        """Restarts the current view, because the workers that rendered it are gone."""
        if self.request is not None:
            wanted = self.wanted
            self.switch_to(self.request, self.view)
            self.wanted = wanted

    def begin_rendering(self, settings: RenderSettings, compiled: str, kind: str, cost_s: float, slots: int) -> None:
        """Sets what to render, and creates the view's resolution levels.

        compiled: SHA-256 of the compiled scene. kind: the worker kind (renderer.jit.kind) that renders it. cost_s: seconds per
        sample of a pixel on one slot. slots: number of slots of that kind.
        """
        assert self.request is not None
        seen = replace(settings, light_groups="", light_paths="off", cryptomatte=0, background="visible")
        levels = levels_of(settings.width, settings.height, self.request.samples, cost_s, max(slots, 1))
        with self._lock:
            self.settings, self.compiled, self.kind = seen, compiled, kind
            self.passes = Passes(levels, cost_s)
            self._canvases = [Canvas(level, settings.film_exponent, self.request.noise) for level in levels]

    def settings_of(self, level: int) -> RenderSettings:
        """Returns the render settings of a level: those of the view, with the level's width and height. level: its index."""
        assert self.settings is not None
        assert self.passes is not None
        of = self.passes.levels[level]
        return replace(self.settings, width=of.width, height=of.height)

    def add(self, piece: Piece, sums: Sums) -> None:
        """Adds the sums of a piece to the picture. Ignores a piece of a tile that needs no more samples."""
        with self._lock:
            canvas = self._canvases[piece.level]
            if canvas.tile_is_complete(piece.tile):  # arrived after the tile had reached its noise target
                return
            canvas.add(piece.tile, piece.first, piece.count, sums)
            self.has_picture = self.has_picture or canvas.samples > 0
        if self.passes is not None and canvas.tile_is_complete(piece.tile):
            self.passes.complete_tile(piece.level, piece.tile)

    @property
    def samples(self) -> int:
        """Samples per pixel of the full-size view's tile that has the fewest."""
        with self._lock:
            return self._canvases[-1].samples if self._canvases else 0

    @property
    def mean_samples(self) -> float:
        """Samples per pixel of the full-size view, averaged over its pixels."""
        with self._lock:
            return self._canvases[-1].mean_samples if self._canvases else 0.0

    @property
    def noise(self) -> float | None:
        """Relative noise of the full-size view; None until it is measured."""
        with self._lock:
            return self._canvases[-1].noise if self._canvases else None

    @property
    def is_done(self) -> bool:
        """Returns True if every tile of the full-size view has all samples or has reached its noise target."""
        with self._lock:
            return bool(self._canvases) and self._canvases[-1].is_complete

    @property
    def max_samples(self) -> int:
        """Requested number of samples per pixel; 0 without a view."""
        return self.request.samples if self.request else 0

    def is_picture_due(self) -> bool:
        """Returns True if it is time to send a picture."""
        with self._lock:
            return self._due_level() is not None

    def take_packet(self, seq: int) -> bytes | None:
        """Returns the changed tiles of the picture as a packet with sequence number `seq`; None if no picture is due."""
        with self._lock:
            level = self._due_level()
            if level is None or self.request is None:
                return None
            canvas, request = self._canvases[level], self.request
            if level != self._shown:
                self._shown = level
                for lower in self._canvases[:level]:
                    lower.changed.clear()
            self._shown_samples, self._taken = canvas.samples, time.monotonic()
            is_whole = level == len(self._canvases) - 1
            tiles = [(canvas.level.tiles[tile], *canvas.take_tile(tile)) for tile in list(canvas.changed)]
        shown = [ViewTile(rect, mean, samples, is_whole and is_complete) for rect, mean, samples, is_complete in tiles]
        size, whole = (canvas.level.width, canvas.level.height), (request.settings.width, request.settings.height)
        return encode_view(shown, size, whole, request.id, seq)

    def _due_level(self) -> int | None:
        """Returns the index of the resolution level whose picture is to be sent now, or None."""
        for level in range(len(self._canvases) - 1, max(self._shown, 0) - 1, -1):
            canvas = self._canvases[level]
            if not canvas.changed:
                continue
            at_least = 2 * self._shown_samples if level == self._shown else 1
            if canvas.samples >= max(at_least, 1) or canvas.is_complete:
                return level
            may_be_mixed = level == self._shown or (level == len(self._canvases) - 1 and self._shown >= 0)
            now = time.monotonic()
            if may_be_mixed and now - self._taken >= min(max(SHOW_EVERY_S, 0.05 * (now - self.begun)), SHOW_CONVERGED_S):
                return level
        return None
