"""Blender's export of a scene's files, stored with the scene and reused for other scenes with the same files.

The rendered result therefore depends on the upload alone, not on the Blender version that a worker has later.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from protocol.blends import is_blend
from service.store.models import Scene

__all__ = ["blend_of", "is_to_be_opened"]


def blend_of(session: Session, scene: Scene) -> dict[str, Any] | None:
    """Returns `SceneInfo.blend` of a scene, or None.

    Looks at the scene itself, then at the upload it was derived from (`scene.of`), then at the oldest other scene with the same
    files. None if the main file is no .blend, or if Blender has not exported these files yet.
    """
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
    """Returns True if Blender must export the scene's files before it can be compiled."""
    return is_blend(scene.main) and blend_of(session, scene) is None


def _own(scene: Scene) -> dict[str, Any] | None:
    found = (scene.info or {}).get("blend")
    return found if isinstance(found, dict) else None


def _files(scene: Scene) -> set[tuple[str, str]]:
    """Returns the scene's files as (path, sha256), without its environment image."""
    return {(ref["path"], ref["sha256"]) for ref in scene.files if ref["path"] != scene.environment}
