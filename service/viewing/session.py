"""Session of a live view: the requested view, its pictures so far, and the messages to the page.

The scheduler's thread adds sums; threads of the event loop read pictures. A lock protects the sums; drafts need none.
"""

from __future__ import annotations

import math
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from protocol.pictures import DraftHead, ViewTile, encode_draft, encode_view
from protocol.viewport import Picked
from renderer.film import Sums
from renderer.image import rgbe9995
from renderer.settings import RenderSettings
from service.viewing.canvas import Canvas
from service.viewing.denoised import DENOISING_FAILURES_ALLOWED, DenoisedView
from service.viewing.passes import FIRST_GUIDES, DraftSize, Passes, Piece, has_guides, levels_of
from service.viewing.view_request import ViewRequest, view_hash

__all__ = ["SettledPicture", "ViewSession"]

SHOW_EVERY_S = 0.25  # while a picture is incomplete
SHOW_CONVERGED_S = 2.0  # for a view that has been shown for long and changes slowly
MIN_PICTURE_WAIT_S = 0.5  # a view without a picture is replaced only after this time, so that dragging shows pictures
MIN_DRAFT_WAIT_S = 2.0  # the same until its draft has come
FIRST_SAMPLES = 2  # per pixel, with which a view is denoised first: edges of one sample are ragged
# It is denoised first with FIRST_GUIDES samples per pixel if these take at most this time: denoising fewer would save none.
FIRST_DENOISED_S = 0.5
FEW_SLOTS = 8  # up to which denoising slows down by several times if all of them render meanwhile
COST_SAMPLES = 2  # per pixel, with which a view's cost is known: single pieces may be of the sky alone
DRAFT_REST_S = 0.1  # after a draft, without a request for another view, until the view is rendered
MIN_DENOISED_WAIT_S = 1.0  # the same while its first picture is being denoised
FIRST_PICTURE_S = 5.0  # after its first view, for which a session without a picture precedes the others


class SettledPicture(NamedTuple):
    """A picture of a scene's home view that a page may show later.

    scene: id of the uploaded scene. color: (h, w, 3), linear. kind: of the workers that rendered it. view: `view_hash` of what it
    shows.
    """

    scene: str
    color: npt.NDArray[np.float32]
    samples: float  # per pixel, on average
    is_denoised: bool
    kind: str
    view: str


class ViewSession:
    """State of a live view that a page shows over one WebSocket. The route creates it and passes it to the view scheduler."""

    def __init__(self, wake: Callable[[], None], *, compiles: bool = True) -> None:
        """Creates a session without a view.

        wake: called in the scheduler's thread when there is a message or a picture to send. compiles: whether workers compile the
        view's kernel if they have none; otherwise such a view fails with `lacks_kernel`.
        """
        self.id = uuid.uuid4().hex[:16]
        self.wake = wake
        self.is_paused = False
        self.is_closed = False
        self.is_ending = False  # whether its page was left, and only its last picture is still denoised
        self.left_at = -math.inf  # monotonic time at which it was left
        self._is_denoised_enough = False  # whether that picture was being denoised when the page was left
        self.compiles = compiles
        self.lacks_kernel = False
        self.wanted: ViewRequest | None = None
        self.request: ViewRequest | None = None  # being rendered
        self.view = 0  # number of the view
        self.kind = ""
        self.compiled = ""
        self.settings: RenderSettings | None = None  # None until the frame is prepared
        self.message: str | None = None  # reason for the lack of new pictures
        self.error: str | None = None
        self.slots = 0
        self._has_few_slots = False
        self.picked: list[Picked] = []  # for the page
        self.pick: tuple[int, int] | None = None
        self.passes: Passes | None = None
        self.begun = 0.0
        self.has_picture = False  # of this view
        self._had_picture = False  # of an earlier view
        self._first_begun = 0.0  # when the first view began; 0: not yet
        self._cost = (0.0, 0)  # slot-seconds and samples of this view's pieces that processors rendered in full size
        self.served = 0  # sequence number of its latest message
        self._lock = threading.Lock()
        self._canvases: list[Canvas] = []
        self._shown = -1  # level of the latest picture taken
        self._shown_samples = 0
        self._taken = 0.0
        self._denoised: DenoisedView | None = None  # None: the view is not denoised
        self.draft_size: DraftSize | None = None  # of this view's draft; None: it has none
        self._drafted = 0.0  # when that came; 0: not yet
        self._draft: deque[tuple[DraftHead, bytes]] = deque(maxlen=1)  # not taken yet; it may be of the previous view
        self._undrafted = 0  # the latest view whose draft was lost

    @property
    def is_ready_for_next(self) -> bool:
        """Returns True if the requested view may replace the current one now.

        That is so once the current view has shown a picture, a denoised one or its draft if it is to be denoised, an error or a
        message, or has run for MIN_PICTURE_WAIT_S seconds, MIN_DENOISED_WAIT_S while its first picture is being denoised, or
        MIN_DRAFT_WAIT_S while its draft is being rendered.
        """
        if self.wanted is None:
            return False
        has_picture = self.has_picture if self._denoised is None or self.draft_size else self._denoised.has_shown
        is_over = self.request is None or has_picture or self.error is not None or self.message is not None
        is_denoising = self._denoised is not None and self._denoised.means is not None
        wait_s = MIN_DENOISED_WAIT_S if is_denoising else MIN_DRAFT_WAIT_S if self.draft_size else MIN_PICTURE_WAIT_S
        return is_over or time.monotonic() - self.begun > wait_s

    def switch_to(self, request: ViewRequest, view: int) -> None:
        """Replaces the current view by a requested one, and discards its pictures. view: number of the new view."""
        with self._lock:
            self.request, self.view, self.wanted = request, view, None
            self.settings, self.passes, self._denoised = None, None, None
            self.message = self.error = None
            self._had_picture = self._had_picture or self.has_picture
            self.begun, self.has_picture, self._cost = time.monotonic(), False, (0.0, 0)
            self._first_begun = self._first_begun or self.begun
            self._canvases, self._shown, self._shown_samples = [], -1, 0
            self.draft_size, self._drafted = None, 0.0

    @property
    def awaits_first_picture(self) -> bool:
        """Returns True if the session is rendered and has had no picture of any view, in its first FIRST_PICTURE_S seconds.

        A session that only renders a poster, for which no kernel is compiled, does not.
        """
        if not self.compiles or self.passes is None or self.is_paused or self.has_picture or self._had_picture:
            return False
        return time.monotonic() - self._first_begun < FIRST_PICTURE_S

    def free_pictures(self) -> None:
        """Frees the pictures of a closed session at once, although other objects may still refer to the session."""
        with self._lock:
            self.settings, self.passes, self._canvases, self._denoised = None, None, [], None
            self._draft.clear()

    @property
    def pixels(self) -> int:
        """Number of pixels of the picture that is held in memory; those of a denoised view count twice."""
        return self.settings.width * self.settings.height * (2 if self._denoised else 1) if self.settings else 0

    def restart(self) -> None:
        """Restarts the current view, because the workers that rendered it are gone."""
        if self.request is not None:
            wanted = self.wanted
            self.switch_to(self.request, self.view)
            self.wanted = wanted

    def begin_rendering(
        self,
        settings: RenderSettings,
        compiled: str,
        kind: str,
        cost_s: float,
        slots: int,
        denoises: bool = False,
        card_rate: float = 0.0,
        draft: DraftSize | None = None,
    ) -> None:
        """Sets what to render, and creates the view's resolution levels.

        compiled: SHA-256 of the compiled scene. kind: the worker kind (renderer.jit.kind) that renders it. cost_s: seconds per
        sample of a pixel on one slot. slots: number of slots of that kind. denoises: whether the view is denoised.
        card_rate: samples of a pixel per second of graphics cards that render it, too. draft: of the draft that precedes them, in
        place of a small picture, unless the view has alpha, or has lost one.
        """
        assert self.request is not None
        self._has_few_slots = slots <= FEW_SLOTS and not card_rate
        seen = replace(settings, light_groups="", light_paths="off", cryptomatte=0, deep=0)
        if not self.request.has_alpha:
            seen = replace(seen, background="visible")
        levels = levels_of(settings.width, settings.height, self.request.samples, cost_s, max(slots, 1), card_rate)
        with self._lock:
            self.settings, self.compiled, self.kind = seen, compiled, kind
            denoises = denoises and not seen.is_transparent  # the denoiser makes no alpha
            if draft is not None and not seen.is_transparent and self.view != self._undrafted:
                self.draft_size, levels = draft, levels[-1:]
            self.passes = Passes(levels, cost_s, has_guides=denoises)
            self._canvases = [
                Canvas(
                    level,
                    settings.film_exponent,
                    self.request.noise,
                    is_transparent=seen.is_transparent,
                    has_guides=denoises,
                )
                for level in levels
            ]
            whole_s = cost_s * settings.width * settings.height / (max(slots, 1) + card_rate * cost_s)  # of one sample a pixel
            first = FIRST_GUIDES if FIRST_GUIDES * whole_s <= FIRST_DENOISED_S else FIRST_SAMPLES
            self._denoised = DenoisedView(max(self._whole_draft_samples, first), keeps=self.request.is_home) if denoises else None

    def end_sampling(self, min_samples: float) -> None:
        """Ends the view with the samples that it has: its page was left.

        They are denoised a last time, unless a picture of `min_samples` samples per pixel is being denoised already.
        """
        with self._lock:
            self.is_ending, self.is_paused, self.left_at = True, False, time.monotonic()
            self._is_denoised_enough = self._denoised is not None and self._denoised.asked >= min_samples
            self.passes, self.wanted, self.wake = None, None, lambda: None

    def awaits_denoising(self, min_samples: float) -> bool:
        """Returns True if a home view has at least `min_samples` samples per pixel, which are still to be denoised."""
        with self._lock:
            if self.request is None or not self.request.is_home or self._denoised is None or not self._canvases:
                return False
            kept = self._denoised.kept
            has_samples = self._canvases[-1].samples > 0 and self._canvases[-1].mean_samples >= min_samples
            return has_samples and (kept is None or kept[1] < min_samples) and self.error is None

    def settings_of(self, piece: Piece) -> RenderSettings:
        """Returns the render settings of a piece: those of the view, with its level's size; a guide's have depth 1."""
        assert self.settings is not None
        assert self.passes is not None
        of = self.passes.levels[piece.level]
        max_depth = 1 if piece.is_guide else self.settings.max_depth
        return replace(self.settings, width=of.width, height=of.height, max_depth=max_depth)

    def add(self, piece: Piece, sums: Sums) -> None:
        """Adds the sums of a piece to the picture. Ignores a piece of a tile that needs no more samples."""
        with self._lock:
            canvas = self._canvases[piece.level]
            if self._denoised is not None and has_guides(piece):
                canvas.add_guides(piece.tile, piece.count, sums)
            if piece.is_guide or canvas.tile_is_complete(piece.tile):  # it may have reached its noise target meanwhile
                return
            canvas.add(piece.tile, piece.first, piece.count, sums)
            self.has_picture = self.has_picture or canvas.samples > 0
        if self.passes is not None and canvas.tile_is_complete(piece.tile):
            self.passes.complete_tile(piece.level, piece.tile)

    def record_cost(self, piece: Piece, seconds: float) -> None:
        """Records the slot-seconds that a processor took for a piece. Those of small pictures do not count."""
        with self._lock:
            if piece.level == len(self._canvases) - 1:
                tile = self._canvases[piece.level].level.tiles[piece.tile]
                self._cost = self._cost[0] + seconds, self._cost[1] + tile.w * tile.h * piece.count

    @property
    def sample_s(self) -> float | None:
        """Slot-seconds for one sample of a pixel of this view; None before all of its pixels have COST_SAMPLES samples."""
        with self._lock:
            if not self._canvases or self._canvases[-1].samples < COST_SAMPLES or not self._cost[1]:
                return None
            return self._cost[0] / self._cost[1]

    @property
    def denoises(self) -> bool:
        """Returns True if the view is denoised."""
        return self._denoised is not None

    def needs_guides(self, pieces: list[Piece]) -> bool:
        """Returns True if albedo and normal of these pieces, which are of one level, guide the denoiser."""
        return self._denoised is not None and any(map(has_guides, pieces))

    def begin_denoising(self) -> tuple[int, int, bool] | None:
        """Sets `means_to_denoise` if a picture is to be denoised now. Returns its size, and whether its guides are clean.

        Returns None if no picture is due. Clean guides have at least FIRST_GUIDES samples per pixel.
        """
        with self._lock:
            if self._denoised is None or not self._canvases or (self._is_denoised_enough and self._denoised.failures == 0):
                return None
            last = len(self._canvases) - 1
            canvas = self._canvases[last]
            is_complete = canvas.is_complete or self.is_ending
            awaits_guides = not canvas.has_all_guides and not is_complete
            if not awaits_guides and self._denoised.is_due(canvas.samples, canvas.mean_samples, is_complete):
                self._denoised.begin(*canvas.means(), canvas.mean_samples, last)
                return canvas.level.width, canvas.level.height, canvas.has_all_guides
            for level in range(last - 1, -1, -1):
                canvas = self._canvases[level]
                if self._denoised.is_small_due(level, canvas.is_complete):
                    self._denoised.begin(*canvas.means(), canvas.mean_samples, level, is_whole=False)
                    return canvas.level.width, canvas.level.height, False
            return None

    @property
    def means_to_denoise(self) -> bytes | None:
        """The picture that a worker is to denoise: colour, albedo, normal, each (h, w, 3) float32; None: there is none."""
        denoised = self._denoised
        return None if denoised is None else denoised.means

    def end_denoising(self, words: bytes | None) -> None:
        """Stores the denoised picture, which are RGB9E5 words; None: it was lost. Raises ValueError if it has another size."""
        with self._lock:
            if self._denoised is None or not self._canvases:
                return
            level = self._canvases[self._denoised.level].level
            self._denoised.end(None if words is None else np.frombuffer(words, "<u4").reshape(level.height, level.width))

    def fail_denoising(self) -> None:
        """Records a failed denoising. After DENOISING_FAILURES_ALLOWED in succession the view shows its noise."""
        with self._lock:
            if self._denoised is None:
                return
            self._denoised.end(None)
            if self._denoised.failures >= DENOISING_FAILURES_ALLOWED:
                self._denoised = None

    @property
    def spares_slots(self) -> bool:
        """Returns True if the view's pieces wait, since the first denoising needs the cores of the farm's few slots."""
        denoised = self._denoised
        return self._has_few_slots and denoised is not None and denoised.is_first

    @property
    def piece_wait_s(self) -> float:
        """Seconds until the view's pieces may be sent; infinite until its draft has come."""
        if self.draft_size is None:
            return 0.0
        return self._drafted + DRAFT_REST_S - time.monotonic() if self._drafted else math.inf

    def put_draft(self, jpeg: bytes) -> None:
        """Stores the view's draft, which is shown once, and replaces an earlier one that was not taken."""
        assert self.request is not None
        assert self.draft_size is not None
        assert self.request.draft_exposure is not None
        width, height, samples = self.draft_size
        whole = self.request.settings.width, self.request.settings.height
        head = DraftHead(self.request.id, 0, width, height, *whole, samples, self.request.draft_exposure)
        with self._lock:
            self._drafted, self.has_picture = time.monotonic(), True
        self._draft.append((head, jpeg))

    def stop_drafts(self) -> None:
        """Renders the view without a draft, since that was lost, or no card makes it."""
        self._undrafted = self.view
        self.restart()

    @property
    def is_denoised(self) -> bool:
        """Returns True if a denoised picture of the view has been taken."""
        denoised = self._denoised
        return denoised is not None and denoised.has_shown

    def settled_picture(self, min_samples: float, min_denoised: float) -> SettledPicture | None:
        """Returns the latest whole picture of a home view if it has enough samples per pixel; otherwise None.

        min_samples: of a picture that is neither denoised nor complete. min_denoised: of a denoised picture. If the view is
        denoised, only its denoised pictures are returned; of a transparent background or another view, none are.
        """
        with self._lock:
            if self.request is None or not self.request.is_home:
                return None
            if not self._canvases or self.settings is None or self.settings.is_transparent:
                return None
            about = self.kind, view_hash(self.request)
            if self._denoised is None:
                canvas = self._canvases[-1]
                if canvas.samples < min_samples and not canvas.is_complete:
                    return None
                return SettledPicture(self.request.upload, canvas.mean_color(), canvas.mean_samples, False, *about)
            if self._denoised.kept is None or self._denoised.kept[1] < min_denoised:
                return None
            upload, (words, samples) = self.request.upload, self._denoised.kept
        return SettledPicture(upload, rgbe9995.unpack(words), samples, True, *about)

    @property
    def denoised_samples(self) -> float | None:
        """Mean samples per pixel of the denoised picture that was taken last (0: a small one); None if there is none."""
        denoised = self._denoised
        return denoised.shown_samples if denoised is not None and denoised.has_shown else None

    @property
    def samples(self) -> int:
        """Samples per pixel of the full-size view's tile that has the fewest."""
        with self._lock:
            return max(self._canvases[-1].samples, self._draft_samples) if self._canvases else 0

    @property
    def mean_samples(self) -> float:
        """Samples per pixel of the full-size view, averaged over its pixels."""
        with self._lock:
            return max(self._canvases[-1].mean_samples, self._draft_samples) if self._canvases else 0.0

    @property
    def _draft_samples(self) -> int:
        """Samples per pixel of the draft that has come, if it has the view's full size; otherwise 0."""
        return self._whole_draft_samples if self._drafted else 0

    @property
    def _whole_draft_samples(self) -> int:
        """Samples per pixel of the view's draft, if it has the view's full size; otherwise 0."""
        size, level = self.draft_size, self._canvases[-1].level
        return size.samples if size is not None and (size.width, size.height) == (level.width, level.height) else 0

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
            return self._has_denoised() or self._due_level() is not None

    def _has_denoised(self) -> bool:
        return self._denoised is not None and self._denoised.has_picture

    def take_draft(self, seq: int) -> bytes | None:
        """Removes the latest draft, and returns it as a packet with sequence number `seq`; None if there is none."""
        try:
            head, jpeg = self._draft.popleft()
        except IndexError:
            return None
        return encode_draft(head._replace(seq=seq), jpeg)

    def take_packet(self, seq: int) -> bytes | None:
        """Returns the changed tiles of the picture as a packet with sequence number `seq`; None if no picture is due."""
        with self._lock:
            level = self._due_level()
            if self.request is not None and self._has_denoised():
                return self._take_denoised(self.request, seq)
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
        shown = [
            ViewTile(rect, mean, samples, is_whole and is_complete, alpha) for rect, mean, samples, is_complete, alpha in tiles
        ]
        size, whole = (canvas.level.width, canvas.level.height), (request.settings.width, request.settings.height)
        return encode_view(shown, size, whole, request.id, seq)

    def _take_denoised(self, request: ViewRequest, seq: int) -> bytes:
        """Returns the packet with the denoised picture. After it, the view's pictures with noise are not sent."""
        assert self._denoised is not None
        mean, samples = self._denoised.take()
        canvas = self._canvases[-1]
        count = max(round(samples), canvas.most_shown, 1)  # tiles with noise may have been shown with more
        self._shown, self._shown_samples, self._taken = len(self._canvases) - 1, canvas.samples, time.monotonic()
        size = mean.shape[2], mean.shape[1]
        # Exact: without noise, the steps of coarse brightness, 1.5 levels of a display, are visible as blotches.
        tile = ViewTile((0, 0, *size), mean, count, is_exact=True)
        return encode_view([tile], size, (request.settings.width, request.settings.height), request.id, seq)

    def _due_level(self) -> int | None:
        """Returns the index of the resolution level whose picture is to be sent now, or None."""
        if self._denoised is not None and (self._denoised.has_shown or self._drafted):
            return None
        for level in range(len(self._canvases) - 1, max(self._shown, 0) - 1, -1):
            canvas = self._canvases[level]
            if not canvas.changed:
                continue
            at_least = 2 * self._shown_samples if level == self._shown else max(self._draft_samples, 1)
            if canvas.samples >= max(at_least, 1) or canvas.is_complete:
                return level
            may_be_mixed = level == self._shown or (level == len(self._canvases) - 1 and self._shown >= 0)
            now = time.monotonic()
            if may_be_mixed and now - self._taken >= min(max(SHOW_EVERY_S, 0.05 * (now - self.begun)), SHOW_CONVERGED_S):
                return level
        return None
