"""The files that Blender exports from a .blend scene: stored with the scene, and reused by other scenes with the same files.

So the rendered result depends only on the upload, not on the Blender version that a worker has later.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from protocol.blends import is_blend
from service.store.models import Scene

__all__ = ["blender_export_of", "needs_blender"]


def blender_export_of(session: Session, scene: Scene) -> dict[str, Any] | None:
    """Returns the stored Blender export (`SceneInfo.blend`) for a scene; None if there is none.

    Searches the scene itself, then the upload from which it was derived (`scene.of`), then the oldest other scene with the same
    files. Returns None if the main file is not a .blend file, or if Blender has not exported these files yet.
    """
    if not is_blend(scene.main):
        return None
    if found := _stored_export(scene):
        return found
    base = session.get(Scene, scene.of) if scene.of else None
    if base is not None and (found := _stored_export(base)):
        return found
    wanted = _scene_files(scene)
    query = select(Scene).where(Scene.main == scene.main, Scene.info.is_not(None), Scene.id != scene.id).order_by(Scene.created)
    return next(
        (found for other in session.scalars(query) if _scene_files(other) == wanted and (found := _stored_export(other))), None
    )


def needs_blender(session: Session, scene: Scene) -> bool:
    """Returns True if Blender must export the scene's files before the scene can be compiled."""
    return is_blend(scene.main) and blender_export_of(session, scene) is None


def _stored_export(scene: Scene) -> dict[str, Any] | None:
    found = (scene.info or {}).get("blend")
    return found if isinstance(found, dict) else None


def _scene_files(scene: Scene) -> set[tuple[str, str]]:
    """Returns the scene's files as (path, sha256), without its environment image."""
    return {(ref["path"], ref["sha256"]) for ref in scene.files if ref["path"] != scene.environment}
