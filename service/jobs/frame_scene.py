"""The compiled scene and the settings of a job's frame, from which a worker renders more of it for a client."""

from __future__ import annotations

from protocol.contract import PrepareFrames
from renderer.frames import frame_number
from renderer.settings import OPTIONAL, RenderSettings
from service.intake.frame_view import requested_view
from service.shot import Shot, variation_of
from service.store.models import Frame, Job, Scene

__all__ = ["frame_scene"]

_SHUTTER = tuple(name for name in OPTIONAL if name.startswith("shutter"))


def frame_scene(job: Job, scene: Scene, row: Frame | None, kind: str) -> tuple[str, RenderSettings, PrepareFrames | None] | None:
    """Returns (SHA-256 of the compiled scene's blob, settings, moment) of a frame; None if it is not prepared yet.

    scene: the job's, compiled for the worker kind `kind`. row: of the frame. moment: request to compile the frame, if its
    compiled scene is no longer stored; the first of the three is then the scene at its beginning. Raises SettingsError if this
    release cannot read the settings.
    """
    base = str(scene.compiled[kind]["sha256"])
    shot = Shot.parse(job.shot)
    if shot is None:
        return base, RenderSettings.from_json(job.settings or {}), None
    if row is None or row.settings is None:
        return None
    settings = RenderSettings.from_json(row.settings)
    own = (row.compiled or {}).get(kind)
    if own is not None:
        return str(own["sha256"]), settings, None
    moment = PrepareFrames(
        work="",
        job="",
        scene=scene.id,
        frames=[row.number],
        base=base,
        base_auto=(scene.info or {})["cameras"][-1]["view"],
        fps=shot.fps,
        clip=shot.clip,
        camera=job.request.get("camera"),
        view=requested_view(job.request, frame_number(row.number)),
        turntable=shot.turntable,
        shutter={name: job.request[name] for name in _SHUTTER if job.request.get(name) is not None},
        vary=variation_of(job.request, shot),
    )
    return base, settings, moment
