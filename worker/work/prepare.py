"""Prepares a scene: from untrusted files to a compiled scene and a summary."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from protocol.blends import is_blend
from protocol.contract import BlobRef, Manifest, SceneInfo, ScenePreview
from renderer import jit
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.blender.convert import convert
from renderer.blender.program import find
from renderer.render import kernel_name, warm_up
from renderer.sentences import Sentence
from worker.exchange.errors import WorkError, storage_errors
from worker.process.context import WorkerContext
from worker.reading.prepare import COMPILE, PREVIEW, prepare
from worker.work.files import memory_budget, place_files
from worker.work.reader import ReaderFolder, has_plain_kernel, translated_errors
from worker.work.relight import relight
from worker.work.scenes import store, store_scene

__all__ = ["prepare_scene"]

SECONDS = 600.0  # below Celery's task_time_limit
MAX_NAMES = 10_000
RESERVED_S = 120.0  # seconds reserved for the files that Blender wrote
CONVERTED_FOLDER = "written"
COMPILING = Sentence("compiling-renderer", "compiling the renderer, once: about 40 s")

Progress = Callable[[str, float], None]
ShowPreview = Callable[[ScenePreview], None]


@storage_errors()
def prepare_scene(
    worker: WorkerContext, manifest: Manifest, progress: Progress, show: ShowPreview = lambda preview: None
) -> SceneInfo:
    """Prepares an uploaded scene and stores the results at the service.

    progress: called with the name of the current step and the completed fraction. show: called with a preview once the scene is
    read. Raises WorkError with a sentence if the files are not a scene; TemporaryError, UnfitError or RefusedError if the
    service or this machine cannot be used.
    """
    begun = time.monotonic()
    if (info := relight(worker, manifest)) is not None:
        return replace(info, seconds=time.monotonic() - begun)
    try:
        return _prepare_in_reader(worker, manifest, progress, show, begun)
    except WorkError:
        # Damaged files in the cache are not errors of the scene.
        if not [file for file in manifest.files if worker.cache.discard_damaged(file.sha256)]:
            raise
    return _prepare_in_reader(worker, manifest, progress, show, begun)


def _prepare_in_reader(
    worker: WorkerContext, manifest: Manifest, progress: Progress, show: ShowPreview, begun: float
) -> SceneInfo:
    with ReaderFolder("prepare") as room:
        progress(Sentence("progress-fetching-files", "fetching files"), 0.0)
        place_files(worker, manifest, room.scene)
        read, written = manifest, list[str]()
        if is_blend(manifest.main):
            progress(Sentence("progress-opening-blender", "opening in Blender"), 0.02)
            written = _convert_with_blender(manifest, room)
            read = replace(manifest, main=written[0])
        folder = room.folder / CONVERTED_FOLDER if written else room.scene

        preview: BlobRef | None = None

        def handle_message(message: dict[str, Any]) -> None:
            nonlocal preview
            if isinstance(shown := message.get("preview"), dict) and preview is None and room.has_file(room.out / PREVIEW):
                preview = store(worker, room.out / PREVIEW)
                show(ScenePreview(preview, shown.get("cameras", []), shown.get("bounds", []), shown.get("defaults", {})))
            progress(str(message.get("step")), float(message.get("fraction", 0.0)))

        job = partial(prepare, os.fsencode(folder), read, os.fsencode(room.out))
        calls = {COMPILE: lambda: _compile_plain_kernel(progress)}
        summary = room.run(job, manifest.main, SECONDS, handle_message, calls=calls, reads=[folder], needs_kernels=False)
        _compile_kernel(summary.get("variant"), progress)
        progress("storing", 0.95)
        compiled = store_scene(worker, room.compiled(summary.get("compiled")))
        if written:
            files = [replace(store(worker, folder / name), path=name) for name in written]
            summary["blend"] = {"main": written[0], "files": [asdict(file) for file in files]}
    try:
        return replace(_scene_info(worker, summary, compiled, begun), preview=preview)
    except (KeyError, TypeError, AttributeError) as error:
        raise WorkError(
            Sentence(
                "reader-summary-incomplete",
                "{file}: the summary of its reader is incomplete ({error})",
                file=manifest.main,
                error=error,
            )
        ) from error


def _scene_info(worker: WorkerContext, summary: dict[str, Any], compiled: BlobRef, begun: float) -> SceneInfo:
    return SceneInfo(
        kind=worker.kind,
        compiled=compiled,
        thumbnail=None,  # made once jobs may begin: worker.work.thumbnail
        cameras=summary["cameras"],
        counts=summary["counts"],
        bounds=summary["bounds"],
        animations=summary["animations"],
        variants=summary["variants"],
        warnings=summary["warnings"],
        defaults=summary["defaults"],
        seconds=time.monotonic() - begun,
        fps=summary.get("fps", 24.0),
        clips=summary.get("clips", []),
        lights_power=summary.get("lights_power"),
        up_axis=summary.get("up_axis"),
        floor=bool(summary.get("floor")),
        blend=summary.get("blend"),
        vary=summary.get("vary"),
        names={kind: summary.get(kind, [])[:MAX_NAMES] for kind in ("objects", "materials", "light_groups")},
    )


def _compile_plain_kernel(progress: Progress) -> None:
    """Compiles the plain kernel, and with it the kernels that prepare scenes, unless this machine has them cached.

    Usually a starting worker is compiling them already (worker/exchange/kernel_precompile.py), and this waits for it.
    """
    if not has_plain_kernel():
        progress(COMPILING, 0.3)
        warm_up()


def _compile_kernel(variant: Any, progress: Progress) -> None:
    """Compiles the kernel that renders the scene, unless this machine has it cached.

    Slots and confined readers, which cannot store kernels, load it from the cache.
    """
    if isinstance(variant, str) and variant in KERNEL_VARIANTS and not jit.is_cached(kernel_name(variant=variant)):
        progress(COMPILING, 0.85)
        warm_up(variant=variant, prepares=False)  # if several slots need the kernel, only one compiles it


def _convert_with_blender(manifest: Manifest, folder: ReaderFolder) -> list[str]:
    """Converts a .blend scene with Blender into the subfolder CONVERTED_FOLDER of the reader's folder.

    Returns the names of the written files, main file first. Raises WorkError.
    """
    written = folder.folder / CONVERTED_FOLDER
    written.mkdir()
    with translated_errors():
        if (blender := find()) is None:
            raise WorkError(
                Sentence(
                    "worker-without-blender",
                    "{file}: this worker has no Blender any more; restart it with --blender",
                    file=manifest.main,
                )
            )
        main = convert(blender, folder.scene, manifest.main, written, memory_budget(), SECONDS - RESERVED_S)
    files = [main, *sorted(path.name for path in written.iterdir() if path.name != main)]
    if manifest.environment is not None and (folder.scene / manifest.environment).is_file():
        light = written / manifest.environment
        light.parent.mkdir(parents=True, exist_ok=True)
        os.link(folder.scene / manifest.environment, light)
    return files
