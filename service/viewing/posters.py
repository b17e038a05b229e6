"""Posters: one sharp picture of each scene, of the view with which its page opens, shown until that view has samples.

The picture of a live view that shows a scene's home view (`view_request.home_view`) becomes the poster when it has enough
samples, again when it has GROWTH times as many, and when the view is closed. An idle farm renders the home views of the latest
scenes without a poster, as live views without a page. A poster is a JPEG blob to which the scene's row refers, so it is deleted
with the scene; a better one replaces it.
"""

from __future__ import annotations

import contextlib
import io
import logging
import math
import queue
import threading
import time
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from sqlalchemy import select
from sqlalchemy.orm import Session

from renderer.image import tonemap
from renderer.image.darkness import darkness
from service.errors import FarmError
from service.events import Events, ItemChanged, RowWritten
from service.scheduling.snapshot import SnapshotHolder
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.garbage import Garbage
from service.store.models import Scene
from service.viewing.session import SettledPicture, ViewSession
from service.viewing.view_request import HOME_PIXELS, home_view
from service.viewing.view_scheduler import ViewScheduler

__all__ = ["MAX_BYTES", "Posters", "encode_poster", "is_better"]

MIN_DENOISED, MIN_NOISY = 2.0, 16.0  # samples per pixel from which a picture becomes a poster, denoised and not
GROWTH = 4.0  # ratio of samples from which a picture replaces a poster; a smaller one is hardly visible
NOISY_WORTH = 1 / 16  # worth of a sample of a picture that is not denoised, relative to one of a denoised picture
MIN_PIXELS = 960 * 540  # a poster with fewer is replaced by a larger one
SAMPLES = 16  # per pixel of a poster that is rendered without a page
MAX_BYTES, MAX_PIXELS = 1 << 19, 1 << 20
QUALITIES = (95, 85, 70, 40)  # of JPEGs, until one has at most MAX_BYTES
FULL_CHROMA = 90  # quality from which chroma is not subsampled
CURVE = "neutral"  # the page's default
POLL_S = 0.5
IDLE_S = 3.0  # time without jobs, preparations and views after which posters are rendered
MAX_RENDER_S = 180.0  # limit for one poster; the first may compile a kernel
MAX_TAKEN = 8  # pictures of closed views that wait to be stored; further ones are dropped
RECENT = 24  # latest scenes whose posters an idle farm renders: as many as the front page shows at first
ACTIVE = {"queued", "running"}

log = logging.getLogger(__name__)


class Posters:
    """Stores and replaces the scenes' posters, from `start` to `stop`. `take` is thread-safe."""

    def __init__(
        self,
        sessions: Sessions,
        blobs: BlobStore,
        garbage: Garbage,
        views: ViewScheduler,
        board: SnapshotHolder,
        events: Events,
        *,
        renders: bool = True,
    ) -> None:
        """Stores the parameters. renders: whether missing posters are rendered while the farm has nothing else to do."""
        self._sessions = sessions
        self._blobs = blobs
        self._garbage = garbage
        self._views = views
        self._board = board
        self._events = events
        self._taken: queue.Queue[SettledPicture | None] = queue.Queue(MAX_TAKEN)
        # By session and number of its view: samples per pixel of the latest picture that was stored or rejected.
        self._given: dict[tuple[str, int], float] = {}
        self._tried: set[str] = set()  # scenes whose posters were rendered, or cannot be
        self._renders = renders
        self._may_lack = True  # whether scenes may lack posters
        self._busy_at = time.monotonic()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="posters", daemon=True)
        events.subscribe(RowWritten, self._scene_changed)
        events.subscribe(ItemChanged, self._scene_changed)

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

    def take(self, session: ViewSession) -> None:
        """Queues the picture of a session that is about to be closed, unless it was stored or rejected while the view was open.

        Drops it if MAX_TAKEN pictures are queued.
        """
        if session.mean_samples <= self._given.get((session.id, session.view), 0.0):
            return
        picture = session.settled_picture(MIN_NOISY, MIN_DENOISED)
        if picture is not None:
            with contextlib.suppress(queue.Full):
                self._taken.put_nowait(picture)

    def _scene_changed(self, event: RowWritten | ItemChanged) -> None:
        self._may_lack = self._may_lack or event.kind == "scene"

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                try:
                    picture = self._taken.get(timeout=POLL_S)
                except queue.Empty:
                    self._take_from_views()
                    self._render_missing()
                else:
                    if picture is not None:
                        self.store(picture)
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
                self.store(picture)
        self._given = {view: samples for view, samples in self._given.items() if view in views}

    def store(self, picture: SettledPicture) -> bool:
        """Stores a picture as its scene's poster if it is better than the present one. Returns True if so. Raises FarmError."""
        height, width = picture.color.shape[:2]
        made = {"width": width, "height": height, "samples": round(picture.samples, 1), "denoised": picture.is_denoised}
        with self._sessions() as session:
            scene = session.get(Scene, picture.scene)
        if scene is None or not is_better(made, _poster(scene)):
            return False
        writer = self._blobs.writer()
        try:
            writer.write(encode_poster(picture.color))
            made |= {"sha256": writer.sha256, "size": writer.size}
            with self._garbage.pinned([writer.sha256]):
                writer.commit()
                was_put = self._record(picture.scene, made)
        finally:
            writer.discard()
        if was_put:
            self._events.publish(RowWritten("scene", picture.scene))
        return was_put

    def _record(self, id: str, made: dict[str, Any]) -> bool:
        """Writes a poster into the scene's row, and deletes the previous one.

        Returns False, and deletes the new blob, if the scene is gone or has a poster that is as good by now.
        """
        is_put = False

        def put(session: Session) -> set[str]:
            nonlocal is_put
            scene = session.get(Scene, id, with_for_update=True)
            if scene is None or scene.info is None or not is_better(made, before := _poster(scene)):
                return {made["sha256"]}  # the blob is deleted again, unless it has another use
            scene.info = {**scene.info, "poster": made}
            is_put = True
            return {before["sha256"]} - {made["sha256"]} if before else set()

        self._garbage.collect(put)
        return is_put

    def _is_idle(self, own: ViewSession | None = None) -> bool:
        """Returns True if workers are ready and have no work other than the view `own`."""
        board = self._board.latest
        has_work = bool(board.preparing) or board.batches_out > 0 or any(each.state in ACTIVE for each in board.jobs.values())
        ready = [report for report in board.roster.ready_reports() if report.views]
        others = [each for each in self._views.sessions() if each is not own and not each.is_paused]
        is_viewed = any(each.error is None and not each.is_done for each in others)
        return board.fault is None and not has_work and not is_viewed and bool(ready)

    def _render_missing(self) -> None:
        """Renders one missing poster, once the farm has been idle for IDLE_S seconds."""
        if not self._is_idle():
            self._busy_at = time.monotonic()
        if not self._renders or not self._may_lack or time.monotonic() - self._busy_at < IDLE_S:
            return
        self._may_lack = False
        with self._sessions() as session:
            latest = select(Scene).where(Scene.of.is_(None), Scene.status == "ready").order_by(Scene.created.desc()).limit(RECENT)
            scenes = [each for each in session.scalars(latest) if each.id not in self._tried and _lacks_poster(each)]
        for scene in scenes[:1]:
            self._may_lack = True
            self._render(scene)

    def _render(self, scene: Scene) -> None:
        """Renders and stores a scene's poster; stops if other work needs the workers."""
        try:
            request = home_view(scene, SAMPLES)
        except FarmError:
            self._tried.add(scene.id)
            return
        if request.settings.is_transparent:  # a JPEG has no alpha
            self._tried.add(scene.id)
            return
        session = ViewSession(lambda: None)
        until = time.monotonic() + MAX_RENDER_S
        self._views.request_view(session, request)
        try:
            while self._is_idle(session):
                if self._stopping.wait(POLL_S / 2):
                    return
                picture = session.settled_picture(SAMPLES, SAMPLES)
                if picture is not None or session.error is not None or time.monotonic() > until:
                    self._tried.add(scene.id)
                    break
            else:
                self._busy_at = time.monotonic()
                return
        finally:
            self._views.close_session(session)
        if picture is not None:
            self.store(picture)


def is_better(made: dict[str, Any], present: dict[str, Any] | None) -> bool:
    """Returns True if a picture replaces the present poster; None: there is none.

    made, present: width and height in pixels, samples per pixel, and whether denoised.
    """
    if present is None:
        return True
    [pixels, before] = [each["width"] * each["height"] for each in (made, present)]
    [worth, worth_before] = [each["samples"] * (1.0 if each["denoised"] else NOISY_WORTH) for each in (made, present)]
    if before < MIN_PIXELS and pixels > 1.2 * before:
        return worth >= min(MIN_DENOISED, worth_before)
    return pixels >= min(0.8 * before, MIN_PIXELS) and worth >= GROWTH * worth_before


def encode_poster(color: npt.NDArray[np.float32]) -> bytes:
    """Returns a JPEG of a linear picture, (h, w, 3), with the exposure and tone curve of a live view that is opened.

    It has at most about MAX_BYTES bytes and MAX_PIXELS pixels. A picture that looks black is exposed automatically, as there.
    """
    dark = darkness(color)
    pixels = tonemap.apply(color, dark.exposure if dark else 0.0, CURVE)
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    scale = math.sqrt(MAX_PIXELS / (picture.width * picture.height))
    if scale < 1.0:
        picture = picture.resize((max(1, int(picture.width * scale)), max(1, int(picture.height * scale))), Image.Resampling.BOX)
    data = b""
    for quality in QUALITIES:
        out = io.BytesIO()
        picture.save(out, "JPEG", quality=quality, subsampling=0 if quality >= FULL_CHROMA else 2)
        data = out.getvalue()
        if len(data) <= MAX_BYTES:
            break
    return data


def _poster(scene: Scene) -> dict[str, Any] | None:
    found = (scene.info or {}).get("poster")
    return found if isinstance(found, dict) else None


def _lacks_poster(scene: Scene) -> bool:
    """Returns True if a poster of SAMPLES samples and HOME_PIXELS pixels would replace that of a scene.

    The new one is taken to be denoised if the present one is.
    """
    found = _poster(scene)
    made = {"width": HOME_PIXELS, "height": 1, "samples": SAMPLES, "denoised": found is None or found["denoised"]}
    return is_better(made, found)
