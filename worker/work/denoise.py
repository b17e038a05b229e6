"""Denoises a frame: the film's means from the service, Open Image Denoise in a bounded child, the result as a blob.

In a child of its own, because the library keeps threads and memory, which must not stay in a slot that forks.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from renderer import denoise
from renderer.errors import RayfarmError
from worker.exchange.patience import patiently
from worker.process.context import WorkerContext
from worker.protocol.contract import DenoiseFrame
from worker.work.bounded import run_bounded

__all__ = ["denoise_frame"]

SECONDS = 300.0
PATIENCE_S = 10.0  # somebody waits for the picture
MEMORY_BYTES = 2 << 30  # the library works in parts, at most this large in its own judgement
BYTES_A_PIXEL = 400


def denoise_frame(worker: WorkerContext, work: DenoiseFrame) -> dict[str, Any]:
    """The blob of the result, and the film's version and samples that it is of. Raises WorkerError and OSError."""
    with tempfile.TemporaryDirectory(prefix="rayfarm-denoise-") as folder:
        means, result = Path(folder) / "means.f32", Path(folder) / "denoised.f32"
        version, samples = patiently(lambda: _fetch(worker, work, means), PATIENCE_S)
        run_bounded(
            lambda send: _work(means, result, work),
            lambda message: None,
            memory_bytes=MEMORY_BYTES + BYTES_A_PIXEL * work.width * work.height,
            seconds=SECONDS,
            faults=(RayfarmError,),
            subject="The picture",
        )
        blob = patiently(lambda: worker.link.store(result), PATIENCE_S)
    return {"sha256": blob.sha256, "version": version, "samples": samples}


def _fetch(worker: WorkerContext, work: DenoiseFrame, means: Path) -> tuple[str, int]:
    with means.open("wb") as file:
        return worker.link.means(work.job, work.frame, file)


def _work(means: Path, result: Path, work: DenoiseFrame) -> dict[str, Any]:
    color, albedo, normal = np.fromfile(means, "<f4").reshape(3, work.height, work.width, 3)
    denoise.denoise(color, albedo, normal).astype("<f4").tofile(result)
    return {}
