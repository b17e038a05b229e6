"""Posters: one sharp picture of each scene, of the view with which its page opens, shown until that view has samples.

The picture of a live view that shows a scene's home view (`view_request.home_view`) becomes the poster when it has enough
samples, again when it has GROWTH times as many, and when the view is closed (this module). An idle farm renders missing posters
(idle_posters.py). poster_choice.py decides whether a picture replaces a poster; poster_store.py stores it.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections import deque

from service.errors import FarmError
from service.viewing.idle_posters import IdlePosters
from service.viewing.poster_choice import GROWTH, MIN_DENOISED, MIN_NOISY
from service.viewing.poster_store import PosterStore
from service.viewing.session import SettledPicture, ViewSession
from service.viewing.view_scheduler import ViewScheduler

__all__ = ["Posters"]

POLL_S = 0.5
MAX_TAKEN = 8  # pictures of closed views that wait to be stored; further ones are dropped
MAX_ENDING = 4  # views whose pages are closed and whose pictures are being denoised; further ones are closed at once
ENDING_S = 30.0  # limit for that, which takes a second or two unless the machine is busy

log = logging.getLogger(__name__)


class Posters:
    """Takes posters from live views, from `start` to `stop`. `end_session` is thread-safe."""

    def __init__(
        self, store: PosterStore, views: ViewScheduler, stopping: threading.Event, idle: IdlePosters | None = None
    ) -> None:
        """Stores the parameters. stopping: is set by `stop`. idle: renders missing posters; None: they are not rendered."""
        self._store = store
        self._views = views
        self._idle = idle
        self._taken: queue.Queue[SettledPicture | None] = queue.Queue(MAX_TAKEN)
        self._ending: deque[tuple[ViewSession, float]] = deque()  # with the time when they are closed at the latest
        # By session and number of its view: samples per pixel of the latest picture that was stored or rejected.
        self._given: dict[tuple[str, int], float] = {}
        self._stopping = stopping
        self._thread = threading.Thread(target=self._run, name="posters", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread, after the poster that it is storing."""
        self._stopping.set()
        with contextlib.suppress(queue.Full):
            self._taken.put_nowait(None)
        if self._thread.is_alive():
            self._thread.join(5)

    def end_session(self, session: ViewSession) -> None:
        """Closes the session of a page that is left, and stores its picture unless it was stored or rejected already.

        A view whose samples were never denoised is closed once they are, at most ENDING_S seconds later: otherwise a scene that
        was left after a few seconds would have no poster. Drops the picture if MAX_TAKEN are waiting.
        """
        given = self._given.get((session.id, session.view), 0.0)
        if session.awaits_denoising(MIN_DENOISED) and len(self._ending) < MAX_ENDING and not self._stopping.is_set():
            self._views.end_sampling(session, MIN_DENOISED)
            self._ending.append((session, time.monotonic() + ENDING_S))
            return
        picture = session.settled_picture(MIN_NOISY, MIN_DENOISED) if session.mean_samples > given else None
        if picture is not None:
            with contextlib.suppress(queue.Full):
                self._taken.put_nowait(picture)
        self._views.close_session(session)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                try:
                    picture = self._taken.get(timeout=POLL_S)
                except queue.Empty:
                    self._take_from_views()
                    if self._idle is not None:
                        self._idle.render_next()
                else:
                    if picture is not None:
                        self._store.store(picture)
                self._close_ended()
            except FarmError as error:
                log.info("no poster was stored: %s", error)
            except Exception:
                log.exception("the posters failed")
                self._stopping.wait(POLL_S)

    def _take_from_views(self) -> None:
        """Stores the pictures of home views that are open and have become clearer."""
        views = set()
        for session in self._views.sessions():
            view = session.id, session.view
            views.add(view)
            samples, given = session.mean_samples, self._given.get(view, 0.0)
            if samples <= given or (samples < max(MIN_DENOISED, GROWTH * given) and not session.is_done):
                continue
            picture = session.settled_picture(MIN_NOISY, MIN_DENOISED)
            if picture is not None and picture.samples > given:
                self._given[view] = picture.samples
                self._store.store(picture)
        self._given = {view: samples for view, samples in self._given.items() if view in views}

    def _close_ended(self) -> None:
        """Closes the views of pages that were left, and stores their pictures, once these are denoised or have taken too long."""
        for _ in range(len(self._ending)):
            session, until = self._ending.popleft()
            if session.awaits_denoising(MIN_DENOISED) and time.monotonic() < until:
                self._ending.append((session, until))
                continue
            picture = session.settled_picture(MIN_NOISY, MIN_DENOISED)
            self._views.close_session(session)
            if picture is not None:
                self._store.store(picture)
