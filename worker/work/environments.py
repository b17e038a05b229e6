"""An uploaded environment image: read in a bounded child, and turned into a thumbnail."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from renderer.errors import SceneError
from renderer.image import encode
from renderer.image.read import decode
from worker.exchange.patience import patiently
from worker.process.context import WorkerContext
from worker.protocol.contract import BlobRef, Manifest, ShowEnvironment
from worker.work.bounded import Send, run_bounded
from worker.work.files import memory_budget, place_files

__all__ = ["show_environment", "small_picture"]

SECONDS = 120.0
PATIENCE_S = 30.0  # somebody waits for it
NARROWEST, WIDEST = 1.9, 2.1  # an equirectangular image is twice as wide as high


def show_environment(worker: WorkerContext, work: ShowEnvironment) -> dict[str, Any]:
    """The thumbnail's blob. Raises WorkerError and OSError."""
    with tempfile.TemporaryDirectory(prefix="rayfarm-environment-") as name:
        folder, result = Path(name) / "files", Path(name) / "thumbnail.jpg"
        folder.mkdir()
        place_files(worker, Manifest("", work.path, [BlobRef(work.path, work.sha256, work.size)]), folder)

        def show(send: Send) -> dict[str, Any]:
            encode.write(result, small_picture(_pixels(folder, work.path), work.width))
            return {}

        run_bounded(
            show, lambda message: None, memory_bytes=memory_budget(), seconds=SECONDS, faults=(SceneError,), subject=work.path
        )
        blob = patiently(lambda: worker.link.store(result), PATIENCE_S)
    return {"sha256": blob.sha256}


def _pixels(folder: Path, path: str) -> np.ndarray:
    pixels = decode((folder / path).read_bytes(), path, is_environment=True).pixels
    height, width = pixels.shape[:2]
    if not NARROWEST < width / height < WIDEST:
        raise SceneError(
            f"{path}: is {width}x{height}; an environment shows all directions, and so is twice as wide as high "
            "(equirectangular, also called latitude-longitude)"
        )
    if pixels.dtype != np.float32:
        pixels = (pixels[..., :3].astype(np.float32) / np.iinfo(pixels.dtype).max) ** 2.2
    if not np.isfinite(pixels[..., :3]).any() or not pixels[..., :3].any():
        raise SceneError(f"{path}: is black all over; it lights nothing")
    return np.asarray(pixels[..., :3])


def small_picture(pixels: np.ndarray, width: int) -> np.ndarray:
    """Radiance (h, w, 3) as (width / 2, width, 3): averaged over blocks, exposed for what is not a lamp."""
    height = width // 2
    rows = np.linspace(0, len(pixels), height + 1).astype(int)
    columns = np.linspace(0, pixels.shape[1], width + 1).astype(int)
    clean = np.clip(np.nan_to_num(pixels, nan=0.0, posinf=1e4, neginf=0.0), 0, 1e4).astype(np.float64)
    if min(clean.shape[:2]) < height or clean.shape[1] < width:  # smaller than the picture: each pixel stays as it is
        small = clean[np.minimum(rows[:-1], len(clean) - 1)][:, np.minimum(columns[:-1], clean.shape[1] - 1)]
    else:
        summed = np.add.reduceat(np.add.reduceat(clean, rows[:-1], axis=0), columns[:-1], axis=1)
        small = summed / (np.diff(rows)[:, None, None] * np.diff(columns)[None, :, None])
    grey = small.mean(axis=2)
    level = float(np.minimum(grey, np.quantile(grey, 0.95)).mean())  # a sun or a lamp must not darken the rest
    return (small * (0.6 / max(level, 1e-6))).astype(np.float32)
