"""Denoises a frame: downloads the film's means, runs Open Image Denoise in a confined process, and stores the result as a blob.

A separate process is used because the library does not release its threads and memory.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

from protocol.contract import DenoiseFrame
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.denoise import denoise
from worker.work.reader import ReaderFolder

__all__ = ["denoise_frame"]

SECONDS = 300.0
PATIENCE_S = 10.0  # seconds; a client waits for the picture
MEMORY_BYTES = 2 << 30  # the library works in tiles whose size it chooses for this limit
BYTES_A_PIXEL = 400
DENOISED = "denoised.f32"


def denoise_frame(worker: WorkerContext, work: DenoiseFrame) -> dict[str, Any]:
    """Denoises a frame. Returns the blob's hash, and the film's version and number of samples.

    Raises WorkerError and OSError.
    """
    with ReaderFolder("denoise") as room:
        means = room.scene / "means.f32"
        version, samples = retry_temporary(lambda: _fetch(worker, work, means), PATIENCE_S)
        job = partial(denoise, os.fsencode(means), os.fsencode(room.out / DENOISED), work.width, work.height)
        room.run(job, "The picture", SECONDS, memory=MEMORY_BYTES + BYTES_A_PIXEL * work.width * work.height)
        blob = retry_temporary(lambda: worker.link.store(room.result(DENOISED)), PATIENCE_S)
    return {"sha256": blob.sha256, "version": version, "samples": samples}


def _fetch(worker: WorkerContext, work: DenoiseFrame, means: Path) -> tuple[str, int]:
    with means.open("wb") as file:
        return worker.link.fetch_means(work.job, work.frame, file)
