"""Denoises a live view's picture with Open Image Denoise, in a confined process."""

from __future__ import annotations

import logging
import os
from functools import partial
from pathlib import Path

import numpy as np

from protocol.view_parts import ViewDenoise
from renderer.image import rgbe9995
from worker.exchange.errors import WorkerError
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.denoise import denoise
from worker.work.denoise import BYTES_A_PIXEL, DENOISED, MEMORY_BYTES
from worker.work.reader import ReaderFolder
from worker.work.viewport import PATIENCE_S, ViewAnswers

__all__ = ["denoise_view"]

SECONDS = 30.0

log = logging.getLogger(__name__)


def denoise_view(worker: WorkerContext, work: ViewDenoise) -> None:
    """Denoises the picture, and sends it; sends `failed` if that fails. Does nothing if the view is outdated."""
    answering = ViewAnswers(worker, work)
    if not answering.is_wanted():
        return
    answering.send("begun")
    try:
        with ReaderFolder("denoise") as room:
            means = room.scene / "means.f32"
            retry_temporary(lambda: _fetch(worker, work, means), PATIENCE_S)
            paths = os.fsencode(means), os.fsencode(room.out / DENOISED)
            guides = {"has_clean_guides": work.has_clean_guides}
            job = partial(denoise, *paths, work.width, work.height, is_preview=True, **guides)
            room.run(job, "The picture", SECONDS, memory=MEMORY_BYTES + BYTES_A_PIXEL * work.width * work.height)
            picture = np.fromfile(room.result(DENOISED), "<f4").reshape(work.height, work.width, 3)
        answering.send("denoised", rgbe9995.pack(picture).astype("<u4").tobytes())
        answering.send("over")
    except (WorkerError, OSError, ValueError) as error:
        log.warning("a live view is not denoised: %s", error)
        answering.send("failed", error=str(error))


def _fetch(worker: WorkerContext, work: ViewDenoise, means: Path) -> None:
    with means.open("wb") as file:
        worker.link.fetch_view_means(work.message, file)
