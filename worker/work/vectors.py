"""Motion vectors of a frame, computed by a confined reader and stored as a blob."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

from protocol.contract import FrameVectors
from renderer.vectors import load_kernel
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.vectors import vectors
from worker.work.files import place_files
from worker.work.reader import ReaderFolder

__all__ = ["make_frame_vectors"]

SECONDS = 550.0  # below the service's timeout
PATIENCE_S = 30.0  # seconds; a client waits
VECTORS = "vectors.f32"


def make_frame_vectors(worker: WorkerContext, work: FrameVectors) -> dict[str, Any]:
    """Computes the motion vectors and returns their blob. Raises WorkerError and OSError."""
    manifest = retry_temporary(lambda: worker.link.manifest(work.scene), PATIENCE_S)
    load_kernel()  # compiled here if necessary: a reader cannot store it
    with ReaderFolder("vectors") as room:
        place_files(worker, manifest, room.scene)
        job = partial(vectors, os.fsencode(room.scene), manifest, work, os.fsencode(room.out / VECTORS))
        room.run(job, manifest.main, SECONDS, preload=["renderer.vectors:load_kernel"])
        blob = retry_temporary(lambda: worker.link.store(room.result(VECTORS)), PATIENCE_S)
    return {"sha256": blob.sha256}
