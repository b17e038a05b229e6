"""Selects the scene to render for a request: the uploaded scene, or a scene derived from it.

A derived scene has other lighting, or another material variant, up axis or floor. It has a row of its own, created on demand;
rows that are not in use are deleted, since they can be created again.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, Literal, cast

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from protocol.contract import BlobRef
from renderer.sentences import Sentence
from service.errors import Invalid, NotFound
from service.events import Events, PreparationRequested, RowWritten
from service.intake.projects import UploadOwner, may_be_used_in
from service.intake.record import record
from service.intake.uploads import Upload, changed_upload, light_text, sky_text
from service.store.database import Sessions
from service.store.garbage import Garbage
from service.store.models import ACTIVE_STATES, Environment, Job, Scene

__all__ = ["Lighting", "LitScene", "scene_id_unknown"]

MAX_UNUSED = 12  # unused derived scenes that are kept: users who try lighting often return to one
RECORD_USE_EVERY_S = 60.0
Status = Literal["preparing", "ready", "failed"]


@dataclass(frozen=True)
class LitScene:
    """A scene with the requested lighting and material variant applied, and the state of its preparation.

    error: why the preparation failed. compiled: SHA-256 of its compiled form for the requested worker kind; None if it is not
    compiled yet. blobs: digests of all blobs it refers to.
    """

    id: str
    status: Status
    error: str | None
    compiled: str | None
    blobs: frozenset[str]


class Lighting:
    """Creates and deletes derived scenes. Thread-safe."""

    def __init__(
        self,
        sessions: Sessions,
        garbage: Garbage,
        events: Events,
    ) -> None:
        self._sessions = sessions
        self._garbage = garbage
        self._events = events
        self._lock = threading.Lock()
        self._held: Counter[str] = Counter()

    def restore(self, job: str) -> None:
        """Recreates the derived scene of a job if it was deleted after the job ended.

        Does nothing for jobs with an uploaded scene.
        """
        with self._sessions() as session:
            row = session.get(Job, job)
            if row is None or row.lit is None or session.get(Scene, row.lit) is not None or session.get(Scene, row.scene) is None:
                return
        self.row(row.scene, row.request)

    def scene_for(self, scene: str, request: Mapping[str, Any], kind: str) -> LitScene:
        """Returns the scene to render for a request. If it is not yet compiled for this worker kind, starts compiling it.

        Call again later in that case. request: fields of the job's request, of which `environment`, `variant`, `up` and
        `floor` are used. To use the scene afterwards, callers must hold it (`holding`). Raises NotFound if the scene or image
        does not exist, Invalid if lighting or variant are invalid, or if `up` is given although the file states which axis is up.
        """
        found = self.row(scene, request)
        ref = found.compiled.get(kind)
        is_elsewhere = ref is None and found.status == "ready"  # prepared for another worker kind only
        if is_elsewhere:
            self._events.publish(PreparationRequested(found.id, kind))
        status: Status = "preparing" if is_elsewhere else cast(Status, found.status)
        return LitScene(found.id, status, found.error, ref["sha256"] if ref else None, frozenset(found.blobs))

    def row(self, scene: str, request: Mapping[str, Any]) -> Scene:
        """Returns the database row of the scene to render, created if needed.

        If the request changes nothing, this is the uploaded scene's row. Raises as `scene_for` does.
        """
        base = self._upload(scene)
        stored = self._requested_upload(base, request)
        if stored is None or stored.id == base.id:
            return base
        with self._sessions() as session:
            found = session.get(Scene, stored.id)
        if found is not None and found.status != "failed":
            self._record_use(found)
            return found
        with self._garbage.pinned(ref.sha256 for ref in stored.files), self.holding(stored.id):
            self._upload(scene)  # the scene may have been deleted meanwhile, with its files
            self._requested_upload(base, request)  # and so may the image
            made = record(stored, self._sessions, self._events, parent=base.of or base.id, owner=UploadOwner(base.project))
            self.delete_unused()
        return made

    def find_row(self, scene: str, request: Mapping[str, Any]) -> Scene | None:
        """Returns the row that `row` would return, even if its preparation failed; None if there is none. Creates nothing."""
        base = self._upload(scene)
        stored = self._requested_upload(base, request)
        if stored is None or stored.id == base.id:
            return base
        with self._sessions() as session:
            return session.get(Scene, stored.id)

    @contextmanager
    def holding(self, id: str) -> Iterator[None]:
        """Prevents the deletion of a derived scene and its blobs inside the `with` block, for uses other than jobs."""
        self.hold(id)
        try:
            yield
        finally:
            self.release(id)

    def hold(self, id: str) -> None:
        """Prevents the deletion of a derived scene until `release` is called once for each call of `hold`.

        The scene may already be deleted: check that it exists after this call.
        """
        with self._lock:
            self._held[id] += 1

    def release(self, id: str) -> None:
        """Reverts one call of `hold` for a scene."""
        with self._lock:
            self._held[id] -= 1
            self._held += Counter()

    def delete_unused(self, max_kept: int = MAX_UNUSED) -> None:
        """Deletes unused derived scenes except the `max_kept` most recently used."""
        gone: list[str] = []

        def delete_rows(session: Session) -> set[str]:
            needed = set(session.scalars(select(Job.lit).where(Job.lit.is_not(None), Job.state.in_(ACTIVE_STATES))))
            blobs: set[str] = set()
            with self._lock:
                rows = session.scalars(select(Scene).where(Scene.of.is_not(None)).order_by(Scene.created.desc()))
                idle = [row for row in rows if row.id not in needed and row.id not in self._held]
                for row in idle[max_kept:]:
                    gone.append(row.id)
                    blobs |= row.blobs
                    session.delete(row)
            return blobs

        with self._sessions() as session:
            lit = len(session.scalars(select(Scene.id).where(Scene.of.is_not(None))).all())
        if lit > max_kept:
            self._garbage.collect(delete_rows)
        for id in gone:
            self._events.publish(RowWritten("scene", id))

    def _record_use(self, scene: Scene) -> None:
        """Updates the time of a derived scene's last use, at most once every RECORD_USE_EVERY_S seconds."""
        if scene.of is not None and time.time() - scene.created > RECORD_USE_EVERY_S:
            with self._sessions.begin() as session:
                session.execute(update(Scene).where(Scene.id == scene.id).values(created=time.time()))

    def _upload(self, id: str) -> Scene:
        with self._sessions() as session:
            found = session.get(Scene, id)
        if found is None or found.of is not None:
            raise scene_id_unknown(id)
        return found

    def _requested_upload(self, base: Scene, request: Mapping[str, Any]) -> Upload | None:
        """Returns a copy of the upload with the environment, variant, up axis and floor that the request sets.

        None if the request changes nothing.
        """
        environment: Mapping[str, Any] = request.get("environment") or {}
        light: str | BlobRef | None = None
        if (sky := environment.get("sky")) is not None:
            light = sky_text(sky["elevation"], sky.get("azimuth") or 0.0)
        elif (preset := environment.get("preset")) is not None:
            light = light_text(preset)
        elif (image := environment.get("image")) is not None:
            light = self._image(image, base.project)
        reading = {name: request.get(name) for name in ("variant", "up", "floor")}
        if light is None and all(value is None for value in reading.values()):
            return None
        return changed_upload(base, light, **reading)

    def name_of(self, environment: Mapping[str, Any] | None) -> str | None:
        """Returns the name of the uploaded image in a request's environment, or None if there is none."""
        id = (environment or {}).get("image")
        if id is None:
            return None
        with self._sessions() as session:
            found = session.get(Environment, id)
        return None if found is None else found.name

    def _image(self, id: str, project: str) -> BlobRef:
        with self._sessions() as session:
            found = session.get(Environment, id)
        if found is None or not may_be_used_in(found.project, project):
            raise Invalid(
                Sentence(
                    "environment-id-unknown",
                    "environment: there is no image {id}. GET /api/environments lists those that are there.",
                    id=repr(id[:60]),
                )
            )
        ref = BlobRef.from_json(found.file)
        suffix = PurePosixPath(found.name).suffix.lower()
        return BlobRef(f"rayfarm-environment-{id}{suffix}", ref.sha256, ref.size)


def scene_id_unknown(id: str) -> NotFound:
    """Returns the error for a request whose field `scene` names no uploaded scene."""
    return NotFound(
        Sentence("scene-id-unknown", "scene: there is no scene {id}. Upload it first, by POST /api/scenes.", id=repr(id[:60]))
    )
