"""Which compiled scene a request needs: the upload's own, or one under another light or with another variant of its materials.

The latter are rows beside the upload's, created when somebody asks for them and deleted when nobody needs them: they can be
made again.
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

from service.errors import Invalid, NotFound
from service.events import Events, PreparationRequested, RowWritten
from service.intake.projects import Owner, serves
from service.intake.record import record
from service.intake.uploads import Upload, changed, light_text, sky_text
from service.store.database import Sessions
from service.store.garbage import Garbage
from service.store.models import ACTIVE, Environment, Job, Scene
from worker.protocol.contract import BlobRef

__all__ = ["Lighting", "Lit"]

KEPT = 12  # that nobody needs now: whoever tries lights comes back to one
TOUCHED_S = 60.0
Status = Literal["preparing", "ready", "failed"]


@dataclass(frozen=True)
class Lit:
    """A scene as a request wants it. compiled: the SHA-256 of what it is compiled to for the kind asked for; None: not yet.

    blobs: all that it refers to.
    """

    id: str
    status: Status
    error: str | None
    compiled: str | None
    blobs: frozenset[str]


class Lighting:
    """Makes and forgets lit scenes. Safe to use from several threads."""

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
        """Creates the derived scene of a job again if it was deleted after the job ended. Does nothing for other jobs."""
        with self._sessions() as session:
            row = session.get(Job, job)
            if row is None or row.lit is None or session.get(Scene, row.lit) is not None or session.get(Scene, row.scene) is None:
                return
        self.row(row.scene, row.request.get("environment"), row.request.get("variant"))

    def lit(self, scene: str, environment: Mapping[str, Any] | None, kind: str, variant: str | None = None) -> Lit:
        """What to render for this request by workers of a kind; where it is not prepared for them yet, it will be: ask again.

        environment: as a job's request has it. Whoever goes on using it holds it meanwhile. Raises NotFound where there is no
        such scene or image, Invalid where there is no such light or variant.
        """
        found = self.row(scene, environment, variant)
        ref = found.compiled.get(kind)
        is_elsewhere = ref is None and found.status == "ready"  # it is prepared, but for another kind
        if is_elsewhere:
            self._events.publish(PreparationRequested(found.id, kind))
        status = "preparing" if is_elsewhere else cast(Status, found.status)
        return Lit(found.id, status, found.error, ref["sha256"] if ref else None, frozenset(found.blobs))

    def row(self, scene: str, environment: Mapping[str, Any] | None, variant: str | None = None) -> Scene:
        """The scene to render, made where it is not there: the upload's own row where nothing of it changes. Raises as `lit`."""
        base = self._upload(scene)
        stored = self._wanted(base, environment, variant)
        if stored is None or stored.id == base.id:
            return base
        with self._sessions() as session:
            found = session.get(Scene, stored.id)
        if found is not None and found.status != "failed":
            self._touch(found)
            return found
        with self._garbage.pinned(ref.sha256 for ref in stored.files), self.held(stored.id):
            self._upload(scene)  # where it is deleted by now, its files may be
            self._wanted(base, environment, variant)  # and so may the image
            made = record(stored, self._sessions, self._events, of=base.of or base.id, owner=Owner(base.project))
            self.clear()
        return made

    def known(self, scene: str, environment: Mapping[str, Any] | None, variant: str | None = None) -> Scene | None:
        """As `row`, of what is there, failed or not; None where it would have to be made."""
        base = self._upload(scene)
        stored = self._wanted(base, environment, variant)
        if stored is None or stored.id == base.id:
            return base
        with self._sessions() as session:
            return session.get(Scene, stored.id)

    @contextmanager
    def held(self, id: str) -> Iterator[None]:
        """Keep a lit scene and its blobs while it is used by something else than a job."""
        self.hold(id)
        try:
            yield
        finally:
            self.release(id)

    def hold(self, id: str) -> None:
        """As `held`, until as many calls of `release`. Of what is gone already, it keeps nothing: look after it was held."""
        with self._lock:
            self._held[id] += 1

    def release(self, id: str) -> None:
        """It is used no longer by whom has held it."""
        with self._lock:
            self._held[id] -= 1
            self._held += Counter()

    def clear(self, kept: int = KEPT) -> None:
        """Let go of lit scenes that nobody needs, but for the latest."""
        gone: list[str] = []

        def forget(session: Session) -> set[str]:
            needed = set(session.scalars(select(Job.lit).where(Job.lit.is_not(None), Job.state.in_(ACTIVE))))
            blobs: set[str] = set()
            with self._lock:
                rows = session.scalars(select(Scene).where(Scene.of.is_not(None)).order_by(Scene.created.desc()))
                idle = [row for row in rows if row.id not in needed and row.id not in self._held]
                for row in idle[kept:]:
                    gone.append(row.id)
                    blobs |= row.blobs
                    session.delete(row)
            return blobs

        with self._sessions() as session:
            lit = len(session.scalars(select(Scene.id).where(Scene.of.is_not(None))).all())
        if lit > kept:
            self._garbage.collect(forget)
        for id in gone:
            self._events.publish(RowWritten("scene", id))

    def _touch(self, scene: Scene) -> None:
        """It was asked for again: it is among the latest."""
        if scene.of is not None and time.time() - scene.created > TOUCHED_S:
            with self._sessions.begin() as session:
                session.execute(update(Scene).where(Scene.id == scene.id).values(created=time.time()))

    def _upload(self, id: str) -> Scene:
        with self._sessions() as session:
            found = session.get(Scene, id)
        if found is None or found.of is not None:
            raise NotFound(f"scene: there is no scene {id[:60]!r}. Upload it first, by POST /api/scenes.")
        return found

    def _wanted(self, base: Scene, environment: Mapping[str, Any] | None, variant: str | None) -> Upload | None:
        """The files of what is asked for; None where that is the scene as it is."""
        asked = environment or {}
        light: str | BlobRef | None = None
        if (sky := asked.get("sky")) is not None:
            light = sky_text(sky["elevation"], sky.get("azimuth") or 0.0)
        elif (preset := asked.get("preset")) is not None:
            light = light_text(preset)
        elif (image := asked.get("image")) is not None:
            light = self._image(image, base.project)
        if light is None and variant is None:
            return None
        return changed(base, light, variant)

    def name_of(self, environment: Mapping[str, Any] | None) -> str | None:
        """What the uploaded image is called that lights a request's scene; None where none does."""
        id = (environment or {}).get("image")
        if id is None:
            return None
        with self._sessions() as session:
            found = session.get(Environment, id)
        return None if found is None else found.name

    def _image(self, id: str, project: str) -> BlobRef:
        with self._sessions() as session:
            found = session.get(Environment, id)
        if found is None or not serves(found.project, project):
            raise Invalid(f"environment: there is no image {id[:60]!r}. GET /api/environments lists those that are there.")
        ref = BlobRef.from_json(found.file)
        suffix = PurePosixPath(found.name).suffix.lower()
        return BlobRef(f"rayfarm-environment-{id}{suffix}", ref.sha256, ref.size)
