"""Renders missing posters while the farm has nothing else to do, as live views without a page."""

from __future__ import annotations

import math
import threading
import time

from service.errors import FarmError
from service.events import Events, ItemChanged, RowWritten
from service.scheduling.snapshot import SnapshotHolder
from service.store.database import Sessions
from service.store.models import Scene
from service.viewing.poster_choice import SAMPLES
from service.viewing.poster_store import PosterStore
from service.viewing.session import SettledPicture, ViewSession
from service.viewing.view_request import ViewRequest, home_view
from service.viewing.view_scheduler import ViewScheduler

__all__ = ["IdlePosters"]

POLL_S = 0.25
IDLE_S = 3.0  # time without jobs, preparations, denoising and views after which posters are rendered
MAX_RENDER_S = 180.0  # limit for one poster
RETRY_S = 300.0  # after which a poster is tried again whose kernel was not compiled
RECENT = 24  # latest scenes whose posters are rendered: as many as the front page shows at first
ACTIVE = {"queued", "running"}


class IdlePosters:
    """Renders missing and outdated posters of the latest scenes, one for each call of `render_next`, in the caller's thread.

    It stops as soon as the farm has other work. No kernel is compiled for a poster, since a job that arrives would wait for
    that; a scene without one is tried again RETRY_S seconds later.
    """

    def __init__(
        self,
        sessions: Sessions,
        store: PosterStore,
        views: ViewScheduler,
        board: SnapshotHolder,
        events: Events,
        stopping: threading.Event,
    ) -> None:
        """Stores the parameters. stopping: set when the farm stops."""
        self._sessions = sessions
        self._store = store
        self._views = views
        self._board = board
        self._stopping = stopping
        self._not_before: dict[str, float] = {}  # by scene that lacked a poster at the last look: when it may be tried
        self._look_at = 0.0  # when scenes may lack posters
        self._renderers: frozenset[str] = frozenset()  # of the ready workers at the last look
        self._busy_at = time.monotonic()
        events.subscribe(RowWritten, self._scene_changed)
        events.subscribe(ItemChanged, self._scene_changed)

    def render_next(self) -> None:
        """Renders one missing poster, once the farm has been idle for IDLE_S seconds. Raises FarmError."""
        now = time.monotonic()
        if not self._is_idle():
            self._busy_at = now
        if now - self._busy_at < IDLE_S:
            return
        renderers = self._store.renderers
        if renderers != self._renderers:
            self._renderers, self._look_at = renderers, 0.0
            self._not_before.clear()
        if now < self._look_at:
            return
        self._look_at = math.inf
        lacking = self._store.lacking(RECENT)
        self._not_before = {id: self._not_before.get(id, 0.0) for id in lacking}
        due = next((id for id, at in self._not_before.items() if now >= at), None)
        if due is not None:
            self._look_at = 0.0  # further ones may be missing, also if this one fails
            self._render_poster(due)
        else:
            later = min((at for at in self._not_before.values() if at > now), default=math.inf)
            self._look_at = min(self._look_at, later)

    def _scene_changed(self, event: RowWritten | ItemChanged) -> None:
        if event.kind == "scene":
            self._look_at = 0.0

    def _is_idle(self, own: ViewSession | None = None) -> bool:
        """Returns True if workers are ready and have no work other than the view `own`."""
        board = self._board.latest
        has_work = (
            bool(board.preparing)
            or board.batches_out > 0
            or board.has_requests
            or any(each.state in ACTIVE for each in board.jobs.values())
        )
        ready = [report for report in board.roster.ready_reports() if report.views]
        others = [each for each in self._views.sessions() if each is not own and not each.is_paused]
        is_viewed = any(each.error is None and not each.is_done for each in others)
        return board.fault is None and not has_work and not is_viewed and bool(ready)

    def _render_poster(self, id: str) -> None:
        """Renders and stores a scene's poster, unless the farm gets other work meanwhile."""
        self._not_before[id] = math.inf
        with self._sessions() as session:
            scene = session.get(Scene, id)
        try:
            request = home_view(scene, SAMPLES) if scene is not None else None
        except FarmError:
            return
        if request is None or request.settings.is_transparent:  # a JPEG has no alpha
            return
        picture = self._render_view(id, request)
        if picture is not None:
            self._store.store(picture)

    def _render_view(self, id: str, request: ViewRequest) -> SettledPicture | None:
        """Returns the picture of a view; None if it cannot be rendered, or if the farm got other work or was stopped."""
        session = ViewSession(lambda: None, compiles=False)
        until = time.monotonic() + MAX_RENDER_S
        self._views.request_view(session, request)
        try:
            while session.error is None and time.monotonic() < until:
                if self._stopping.wait(POLL_S):
                    return None
                if not self._is_idle(session):
                    self._not_before[id] = 0.0
                    self._busy_at = time.monotonic()
                    return None
                picture = session.settled_picture(SAMPLES, SAMPLES)
                if picture is not None:
                    return picture
            if session.lacks_kernel:
                self._not_before[id] = time.monotonic() + RETRY_S
            return None
        finally:
            self._views.close_session(session)
