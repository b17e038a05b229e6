"""Builds the command line that reproduces an error, from the worker's command and the job's request."""

from __future__ import annotations

import shlex

from renderer.frames import frame_number, frame_text
from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["reproduce"]


def reproduce(command: str, job: ActiveJob, frame: ActiveFrame | None = None) -> str:
    """Adds the scene's options to a worker's command line; also the time and the camera of `frame`, if given."""
    words = list(job.scene_words)
    if frame is not None and job.shot is not None:
        shot = job.shot
        words.append(f"--frame={frame_text(frame_number(frame.key))}")
        words += [f"--{name}={value}" for name, value in (("fps", shot.fps), ("clip", shot.clip)) if value is not None]
        if frame.settings is not None and frame.settings.views:
            asked = (("camera", job.request.get("camera")), ("turntable", shot.turntable))
            words += [f"--{name}={value}" for name, value in asked if value is not None]
    return " ".join([command, *map(shlex.quote, words)])
