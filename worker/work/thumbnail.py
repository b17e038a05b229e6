"""Renders a prepared scene's thumbnail in a confined process and stores it as a blob."""

from __future__ import annotations

import os
from functools import partial

from protocol.contract import BlobRef, SceneInfo, home_camera
from worker.process.context import WorkerContext
from worker.reading.thumbnail import render_thumbnail
from worker.work.reader import ReaderFolder
from worker.work.scenes import store

__all__ = ["make_thumbnail"]

SECONDS = 120.0
THUMBNAIL = "thumbnail.png"


def make_thumbnail(worker: WorkerContext, info: SceneInfo, subject: str) -> BlobRef:
    """Renders and stores the thumbnail of a prepared scene, seen by its `home_camera`. Raises WorkerError and OSError.

    subject: the scene's main file, for errors.
    """
    compiled = info.compiled.sha256
    with ReaderFolder("thumbnail") as room:
        room.place_base(worker, compiled)
        base, result = os.fsencode(room.base), os.fsencode(room.out / THUMBNAIL)
        view = info.cameras[home_camera(info.cameras)]["view"]
        job = partial(render_thumbnail, base, compiled, view, info.defaults, result)
        room.run(job, subject, SECONDS)
        return store(worker, room.result(THUMBNAIL))
