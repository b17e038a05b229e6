"""What Blender made of a scene's files: kept with the scene, and reused for the same files.

So what is rendered follows from the upload, whichever version of Blender a worker has by then.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.store.models import Scene
from worker.protocol.blends import is_blend

__all__ = ["blend_of", "is_to_be_opened"]


def blend_of(session: Session, scene: Scene) -> dict[str, Any] | None:
    """SceneInfo.blend of a scene: its own, else that of the upload that it is made of, or of another with these files."""
    if not is_blend(scene.main):
        return None
    if found := _own(scene):
        return found
    base = session.get(Scene, scene.of) if scene.of else None
    if base is not None and (found := _own(base)):
        return found
    wanted = _files(scene)
    query = select(Scene).where(Scene.main == scene.main, Scene.info.is_not(None), Scene.id != scene.id).order_by(Scene.created)
    return next((found for other in session.scalars(query) if _files(other) == wanted and (found := _own(other))), None)


def is_to_be_opened(session: Session, scene: Scene) -> bool:
    """Whether Blender has to open it first."""
    return is_blend(scene.main) and blend_of(session, scene) is None


def _own(scene: Scene) -> dict[str, Any] | None:
    found = (scene.info or {}).get("blend")
    return found if isinstance(found, dict) else None


def _files(scene: Scene) -> set[tuple[str, str]]:
    """But for what lights it."""
    return {(ref["path"], ref["sha256"]) for ref in scene.files if ref["path"] != scene.environment}
