"""The compiled scene and the settings of a job's frame, from which a worker renders more of it for a client."""

from __future__ import annotations

from typing import NamedTuple

from protocol.contract import PrepareFrames
from renderer.frames import frame_number
from renderer.settings import OPTIONAL, RenderSettings
from service.intake.frame_view import requested_view
from service.shot import Shot, variation_of
from service.store.models import Frame, Job, Scene

__all__ = ["FrameScene", "frame_scene"]

_SHUTTER = tuple(name for name in OPTIONAL if name.startswith("shutter"))


class FrameScene(NamedTuple):
    """The compiled scene of a frame.

    own: SHA-256 of the form compiled for this frame alone, which may be released at any time; None if there is none, or none any
    more. base: SHA-256 of the scene compiled for the job, of a shot at its beginning. moment: request to compile the frame; None
    for a still, whose scene is `base`.
    """

    base: str
    settings: RenderSettings
    moment: PrepareFrames | None = None
    own: str | None = None


def frame_scene(job: Job, scene: Scene, row: Frame | None, kind: str) -> FrameScene | None:
    """Returns the compiled scene of a frame; None if it is not prepared yet.

    scene: the job's, compiled for the worker kind `kind`. row: of the frame. Raises SettingsError if this release cannot read the
    settings.
    """
    base = str(scene.compiled[kind]["sha256"])
    shot = Shot.parse(job.shot)
    if shot is None:
        return FrameScene(base, RenderSettings.from_json(job.settings or {}))
    if row is None or row.settings is None:
        return None
    own = (row.compiled or {}).get(kind)
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
    return FrameScene(base, RenderSettings.from_json(row.settings), moment, None if own is None else str(own["sha256"]))
