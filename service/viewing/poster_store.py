"""Stores posters: JPEG blobs to which the scenes' rows refer, so that they are deleted with their scenes."""

from __future__ import annotations

import io
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from sqlalchemy import select
from sqlalchemy.orm import Session

from renderer.image import tonemap
from renderer.image.darkness import darkness
from service.errors import FarmError
from service.events import Events, RowWritten
from service.scheduling.snapshot import SnapshotHolder
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.garbage import Garbage
from service.store.models import Scene
from service.viewing.poster_choice import Poster, is_better, is_outdated, is_worth_rendering, poster_of, renderer_of
from service.viewing.session import SettledPicture
from service.viewing.view_request import home_view, view_hash

__all__ = ["MAX_BYTES", "PosterStore", "encode_poster"]

MAX_BYTES, MAX_PIXELS = 1 << 19, 1 << 20
QUALITIES = (95, 85, 70, 40)  # of JPEGs, until one has at most MAX_BYTES
FULL_CHROMA = 90  # quality from which chroma is not subsampled
CURVE = "neutral"  # the page's default


class PosterStore:
    """Stores pictures as posters of their scenes, and finds the scenes that lack one."""

    def __init__(self, sessions: Sessions, blobs: BlobStore, garbage: Garbage, board: SnapshotHolder, events: Events) -> None:
        """Stores the parameters. board: its roster has the workers whose posters are not outdated."""
        self._sessions = sessions
        self._blobs = blobs
        self._garbage = garbage
        self._board = board
        self._events = events

    @property
    def renderers(self) -> frozenset[str]:
        """The renderers of the ready workers (`renderer_of`)."""
        return frozenset(renderer_of(report.kind) for report in self._board.latest.roster.ready_reports())

    def lacking(self, recent: int) -> list[str]:
        """Returns the ids of those of the latest `recent` scenes, newest first, that lack a poster or have an outdated one."""
        latest = select(Scene).where(Scene.of.is_(None), Scene.status == "ready").order_by(Scene.created.desc()).limit(recent)
        with self._sessions() as session:
            posters = ((scene, self._valid_poster(scene, _home_hash(scene))) for scene in session.scalars(latest))
            return [scene.id for scene, poster in posters if is_worth_rendering(poster)]

    def store(self, picture: SettledPicture) -> bool:
        """Stores a picture as its scene's poster if it is better than the present one. Returns True if so. Raises FarmError."""
        height, width = picture.color.shape[:2]
        poster = Poster(width, height, round(picture.samples, 1), picture.is_denoised, renderer_of(picture.kind), picture.view)
        with self._sessions() as session:
            scene = session.get(Scene, picture.scene)
        if scene is None or not self._replaces_present(poster, scene):
            return False
        writer = self._blobs.writer()
        try:
            writer.write(encode_poster(picture.color))
            ref = {"sha256": writer.sha256, "size": writer.size}
            with self._garbage.pinned([writer.sha256]):
                writer.commit()
                was_put = self._record(picture.scene, poster, ref)
        finally:
            writer.discard()
        if was_put:
            self._events.publish(RowWritten("scene", picture.scene))
        return was_put

    def _record(self, id: str, poster: Poster, ref: dict[str, Any]) -> bool:
        """Writes a poster into the scene's row, and deletes the previous one. ref: hash and size of its blob.

        Returns False, and deletes the new blob, if the scene is gone or has a poster that is as good by now.
        """
        is_put = False

        def put(session: Session) -> set[str]:
            nonlocal is_put
            scene = session.get(Scene, id, with_for_update=True)
            if scene is None or scene.info is None or not self._replaces_present(poster, scene):
                return {ref["sha256"]}  # the blob is deleted again, unless it has another use
            before = scene.info.get("poster")
            scene.info = {**scene.info, "poster": {**asdict(poster), **ref}}
            is_put = True
            return {before["sha256"]} - {ref["sha256"]} if isinstance(before, dict) and "sha256" in before else set()

        self._garbage.collect(put)
        return is_put

    def _replaces_present(self, poster: Poster, scene: Scene) -> bool:
        home = _home_hash(scene)
        return poster.view == home and is_better(poster, self._valid_poster(scene, home))

    def _valid_poster(self, scene: Scene, home: str) -> Poster | None:
        """Returns a scene's poster; None if it has none, or an outdated one. home: `_home_hash` of the scene."""
        poster = poster_of(scene)
        return None if poster is None or is_outdated(poster, home, self.renderers) else poster


def _home_hash(scene: Scene) -> str:
    """Returns `view_hash` of a scene's home view; "" if it has none, as a scene that cannot be rendered."""
    try:
        return view_hash(home_view(scene))
    except FarmError:
        return ""


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
