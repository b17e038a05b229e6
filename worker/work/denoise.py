"""Denoises a frame: downloads the film's means, runs Open Image Denoise in a confined process, and stores the result as a blob.

The albedo behind mirrors and smooth glass, which guides the denoising, is rendered before that, by the slot. A separate process
is used because the library does not release its threads and memory.
"""

from __future__ import annotations

import logging
import os
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from protocol.contract import ROUGH_PREVIEW_SAMPLES, VERSION_SEPARATOR, DenoiseFrame, GuideScene
from protocol.view_parts import CLEAN_GUIDE_SAMPLES
from renderer import jit
from renderer.denoise_guides import guide_kernel, guide_scene, guiding_albedo
from renderer.errors import RayfarmError
from renderer.render import is_warm
from renderer.scene.compiled import CompiledScene
from worker.exchange.errors import RefusedError, WorkError
from worker.exchange.ready import make_kernel_ready
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.denoise import denoise, denoise_in_shot, denoise_lights
from worker.work.frames import compiled_frame
from worker.work.open_scenes import mapped_scene
from worker.work.reader import ReaderFolder

__all__ = ["denoise_frame"]

log = logging.getLogger(__name__)

SECONDS = 300.0
MOST_SECONDS = 800.0  # of a frame with its neighbours, below the limit of a task
PATIENCE_S = 10.0  # seconds; a client waits for the picture
MEMORY_BYTES = 2 << 30  # the library works in tiles whose size it chooses for this limit
BYTES_A_PIXEL = 400
BYTES_A_NEIGHBOUR = 200  # a pixel, of each frame that is averaged
BYTES_A_LIGHT = 24  # a pixel, of each light group: with its noise and without
DENOISED = "denoised.f32"


def denoise_frame(worker: WorkerContext, work: DenoiseFrame) -> dict[str, Any]:
    """Denoises a frame. Returns the blob's hash, the film's version and number of samples, and the seconds that it took.

    Raises WorkerError and OSError.
    """
    with ReaderFolder("denoise") as room:
        if work.frames:
            return _denoise_in_shot(worker, work, room)
        means = room.scene / "means.f32"
        version, samples = retry_temporary(lambda: _fetch(worker, work, means), PATIENCE_S)
        if work.guide is not None and not work.is_preview:
            _guide(worker, work, work.guide, means)
        paths = os.fsencode(means), os.fsencode(room.out / DENOISED)
        threads = 1 if work.is_preview else None  # the other cores render
        clean_from = CLEAN_GUIDE_SAMPLES if work.lights else ROUGH_PREVIEW_SAMPLES
        has_clean_guides = samples >= clean_from * work.width * work.height
        options = {"has_clean_guides": has_clean_guides, "threads": threads}
        if work.lights:
            job = partial(denoise_lights, *paths, len(work.lights), work.width, work.height, **options)
        else:
            is_rough = work.is_preview and not has_clean_guides  # in a quarter of the time, so that it is renewed more often
            job = partial(denoise, *paths, work.width, work.height, is_preview=work.is_preview, is_rough=is_rough, **options)
        began = time.monotonic()
        a_pixel = BYTES_A_PIXEL + len(work.lights) * BYTES_A_LIGHT
        room.run(job, "The picture", SECONDS, memory=MEMORY_BYTES + a_pixel * work.width * work.height)
        seconds = time.monotonic() - began
        blob = retry_temporary(lambda: worker.link.store(room.result(DENOISED)), PATIENCE_S)
    return {"sha256": blob.sha256, "version": version, "samples": samples, "seconds": seconds}


def _guide(worker: WorkerContext, work: DenoiseFrame, guide: GuideScene, means: Path) -> None:
    """Replaces the albedo in the file of means by the guide, unless the scene is not to be had.

    Raises TemporaryError, UnfitError, MachineError and OSError.
    """
    shape = 3, work.height, work.width, 3
    if guide.kind != jit.kind() or means.stat().st_size != 4 * np.prod(shape):
        return
    try:
        scene = _scene(worker, guide)
        kernel = None if scene is None else guide_kernel(scene, guide.settings)
        if scene is None or kernel is None:
            return
        if not is_warm(*kernel):
            make_kernel_ready(worker.link, *kernel)
        planes = np.memmap(means, "<f4", "r+", shape=shape)
        planes[1] = guiding_albedo(scene, guide.settings, np.array(planes[1]))
        planes.flush()
    except (RefusedError, WorkError, RayfarmError) as error:
        log.warning("a picture is denoised without the albedo behind mirrors: %s", error)


def _scene(worker: WorkerContext, guide: GuideScene) -> CompiledScene | None:
    """Returns the compiled scene of a frame; None if the one at its beginning needs no guide, so it is not compiled again."""
    if guide.own is not None:
        own = guide.own
        with suppress(RefusedError):  # it is released once the frame is rendered
            return retry_temporary(lambda: mapped_scene(worker, own), PATIENCE_S)
    scene = retry_temporary(lambda: mapped_scene(worker, guide.compiled), PATIENCE_S)
    moment = guide.moment
    if moment is None:
        return scene
    if moment.vary is None and guide_scene(scene) is None:
        return None
    manifest = retry_temporary(lambda: worker.link.manifest(moment.scene), PATIENCE_S)
    return compiled_frame(worker, manifest, moment) or scene


def _denoise_in_shot(worker: WorkerContext, work: DenoiseFrame, room: ReaderFolder) -> dict[str, Any]:
    versions, samples = [], 0
    for index, (frame, motion) in enumerate(work.frames):
        means = partial(_fetch, worker, replace(work, frame=frame), room.scene / f"{index}.means", ids=True)
        version, count = retry_temporary(means, PATIENCE_S)
        retry_temporary(partial(_fetch_blob, worker, motion, room.scene / f"{index}.motion"), PATIENCE_S)
        versions.append(version)
        samples = count if frame == work.frame else samples
    frames = [frame for frame, _ in work.frames]
    paths = os.fsencode(room.scene), os.fsencode(room.out / DENOISED)
    job = partial(denoise_in_shot, *paths, frames, work.frame, work.width, work.height)
    pixels = work.width * work.height
    memory = MEMORY_BYTES + (BYTES_A_PIXEL + len(frames) * BYTES_A_NEIGHBOUR) * pixels
    room.run(job, "The picture", min(SECONDS * len(frames), MOST_SECONDS), memory=memory)
    blob = retry_temporary(lambda: worker.link.store(room.result(DENOISED)), PATIENCE_S)
    return {"sha256": blob.sha256, "version": VERSION_SEPARATOR.join(versions), "samples": samples}


def _fetch(worker: WorkerContext, work: DenoiseFrame, means: Path, ids: bool = False) -> tuple[str, int]:
    with means.open("wb") as file:
        return worker.link.fetch_means(work.job, work.frame, file, ids, work.lights)


def _fetch_blob(worker: WorkerContext, sha256: str, path: Path) -> None:
    with path.open("wb") as file:
        worker.link.fetch(sha256, file)
