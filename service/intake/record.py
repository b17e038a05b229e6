"""A stored upload becomes a scene's row, and is prepared."""

from __future__ import annotations

import time
from dataclasses import asdict

from sqlalchemy.exc import IntegrityError

from service.farm import Farm
from service.intake.uploads import Upload
from service.store.models import Scene

__all__ = ["record"]


def record(stored: Upload, farm: Farm) -> Scene:
    """Write an upload whose blobs are pinned down as a scene, and have it prepared. One that is there already stays as it is."""
    try:
        scene = _write(stored, farm)
    except IntegrityError:  # another wrote the same scene down in the same moment
        scene = _write(stored, farm)
    farm.engine.changed("scene", scene.id)
    farm.broadcast.tell("scene", scene.id)
    return scene


def _write(stored: Upload, farm: Farm) -> Scene:
    with farm.sessions.begin() as session:
        scene = session.get(Scene, stored.id)
        if scene is None:
            scene = Scene(
                id=stored.id,
                name=stored.name,
                status="preparing",
                created=time.time(),
                main=stored.main,
                environment=stored.environment,
                variant=stored.variant,
                files=[asdict(ref) for ref in stored.files],
                bytes=stored.size,
                notes=stored.notes,
                compiled={},
            )
            session.add(scene)
        elif scene.status == "failed":
            scene.status, scene.error = "preparing", None  # another try: the fault may have been the worker's
        return scene
