"""Deletion of a scene."""

from __future__ import annotations

from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.errors import Conflict
from service.events import RowWritten
from service.farm import Farm
from service.jobs.lookup import no_scene
from service.store.models import ACTIVE_STATES, Job, Scene

__all__ = ["delete"]


def delete(id: str, farm: Farm) -> None:
    """Deletes a scene with its files and the scenes derived from it. Raises NotFound; Conflict if unfinished jobs need it."""
    derived: list[str] = []

    def delete_rows(session: Session) -> set[str]:
        scene = session.get(Scene, id, with_for_update=True)
        if scene is None or scene.of is not None:
            raise no_scene(id)
        is_needed = or_(Job.scene == id, Job.lit == id)
        needed = session.scalar(select(func.count()).select_from(Job).where(is_needed, Job.state.in_(ACTIVE_STATES)))
        if needed:
            raise Conflict(
                Sentence("scene-in-use", "{count} unfinished job(s) need this scene. Cancel them first.", count=needed)
            )
        blobs = scene.blobs
        for lit in session.scalars(select(Scene).where(Scene.of == id)):
            blobs |= lit.blobs
            derived.append(lit.id)
            session.delete(lit)
        session.delete(scene)
        return blobs

    farm.reserve.run_deletion(lambda: farm.garbage.collect(delete_rows))
    for each in (*derived, id):
        farm.events.publish(RowWritten("scene", each))
