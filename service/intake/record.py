"""Records a stored upload as a scene in the database and starts its preparation."""

from __future__ import annotations

import time
from dataclasses import asdict

from sqlalchemy.exc import IntegrityError

from service.access.projects import lock_project
from service.events import Events, RowWritten
from service.intake.projects import NO_OWNER, UploadOwner
from service.intake.uploads import Upload
from service.store.database import Sessions
from service.store.models import Scene

__all__ = ["record"]


def record(stored: Upload, sessions: Sessions, events: Events, parent: str | None = None, owner: UploadOwner = NO_OWNER) -> Scene:
    """Records an upload, whose blobs are pinned, as a scene and starts its preparation.

    If the scene exists, it is unchanged, except that a failed one is prepared again. parent: id of the uploaded scene, for a
    derived scene.
    """
    try:
        scene = _write(stored, sessions, parent, owner)
    except IntegrityError:  # another thread recorded the same scene at the same time
        scene = _write(stored, sessions, parent, owner)
    events.publish(RowWritten("scene", scene.id))
    return scene


def _write(stored: Upload, sessions: Sessions, parent: str | None, owner: UploadOwner) -> Scene:
    with sessions.begin() as session:
        scene = session.get(Scene, stored.id)
        if scene is None:
            lock_project(owner.project, session)
            scene = Scene(
                id=stored.id,
                name=stored.name,
                status="preparing",
                created=time.time(),
                main=stored.main,
                environment=stored.environment,
                variant=stored.variant,
                up=stored.up,
                floor=stored.floor,
                of=parent,
                files=[asdict(ref) for ref in stored.files],
                bytes=stored.size,
                notes=stored.notes,
                strict=stored.strict,
                compiled={},
                **asdict(owner),
            )
            session.add(scene)
        elif scene.status == "failed":
            scene.status, scene.error = "preparing", None  # try again: the worker may have been at fault
            scene.notes = stored.notes
        if parent is None and scene.of is not None:
            scene.of, scene.name = None, stored.name  # a derived scene that is uploaded becomes an independent one
            scene.user, scene.key = owner.user, owner.key
        return scene
