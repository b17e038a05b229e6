"""Thumbnail of an uploaded environment image, made by a confined reader."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

from protocol.contract import BlobRef, Manifest, ShowEnvironment
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.environments import write_thumbnail
from worker.work.files import place_files
from worker.work.reader import ReaderFolder

__all__ = ["show_environment"]

SECONDS = 120.0
PATIENCE_S = 30.0  # seconds; a client waits
THUMBNAIL = "thumbnail.jpg"


def show_environment(worker: WorkerContext, work: ShowEnvironment) -> dict[str, Any]:
    """Makes and stores the thumbnail. Returns its blob's hash as `sha256`. Raises WorkerError and OSError."""
    with ReaderFolder("environment") as room:
        place_files(worker, Manifest("", work.path, [BlobRef(work.path, work.sha256, work.size)]), room.scene)
        job = partial(write_thumbnail, os.fsencode(room.scene), work.path, work.width, os.fsencode(room.out / THUMBNAIL))
        room.run(job, work.path, SECONDS)
        blob = retry_temporary(lambda: worker.link.store(room.result(THUMBNAIL)), PATIENCE_S)
    return {"sha256": blob.sha256}
