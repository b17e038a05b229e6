"""Converts scenes from database rows, with the engine's current state, to the API's model."""

from __future__ import annotations

import logging
from dataclasses import asdict
from typing import Any, cast

from renderer.sentences import Sentence
from service.jobs.describe import UNREADABLE_SCENE, farm_stall_reason
from service.models.scenes import MeasuredOut, SceneOut, SceneStatus
from service.scheduling.engine import Engine
from service.scheduling.snapshot import Snapshot
from service.store.models import Scene

__all__ = ["scene_out"]

log = logging.getLogger(__name__)


def scene_out(scene: Scene, engine: Engine) -> SceneOut:
    """Returns the API's model of a scene. A row that this release cannot interpret is described as failed."""
    try:
        return _scene_out(scene, engine)
    except Exception as error:
        log.warning("scene %s cannot be described: %r", scene.id, error)
        plain = Scene(
            **{name: getattr(scene, name) for name in ("id", "name", "created", "main", "bytes", "project")},
            status="failed",
            error=UNREADABLE_SCENE,
            files=[],
            notes=[],
        )
        return _scene_out(plain, engine)


def _scene_out(scene: Scene, engine: Engine) -> SceneOut:
    info: dict[str, Any] = scene.info or {}
    waits = scene.status == "preparing"
    view = engine.snapshot
    preparing = view.preparing.get(scene.id) if waits else None
    if preparing and preparing.preview:
        info = {**asdict(preparing.preview), **info}
    return SceneOut(
        id=scene.id,
        name=scene.name,
        status=cast(SceneStatus, scene.status),
        error=scene.error,
        step=_preparation_step(scene.id, view) if waits else None,
        progress=preparing.fraction if preparing else 0.0 if waits else None,
        created=scene.created,
        main=scene.main,
        files=scene.files,
        bytes=scene.bytes,
        cameras=info.get("cameras", []),
        counts=info.get("counts", {}),
        bounds=info.get("bounds"),
        animations=info.get("animations", []),
        fps=info.get("fps"),
        clips=info.get("clips", []),
        variants=info.get("variants", []),
        light_groups=(info.get("names") or {}).get("light_groups", []),
        variant=scene.variant,
        up_axis=info.get("up_axis"),
        up=scene.up,
        has_floor=bool(info.get("floor")),
        floor=scene.floor,
        environment=scene.environment,
        measured=MeasuredOut(**scene.measured) if scene.measured else None,
        warnings=[*scene.notes, *info.get("warnings", [])],
        strict=bool(scene.strict),
        defaults=info.get("defaults", {}),
        preview=f"/api/scenes/{scene.id}/preview" if info.get("preview") else None,
        thumbnail=f"/api/scenes/{scene.id}/thumbnail.png" if info.get("thumbnail") else None,
        poster=f"/api/scenes/{scene.id}/poster.jpg?v={info['poster']['sha256'][:16]}" if info.get("poster") else None,
        project=scene.project or "",
    )


def _preparation_step(scene: str, view: Snapshot) -> str:
    """Returns a sentence with the current step of a scene's preparation, or the reason why it waits."""
    progress = view.preparing.get(scene)
    return view.waits.get(scene) or (
        progress.step
        if progress
        else farm_stall_reason(view.roster) or Sentence("scene-waits-for-worker", "Waits for a free worker.")
    )
