"""Prepares a scene with another environment: reuses the compiled scene and compiles only the environment."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial

from protocol.contract import Manifest, SceneInfo
from renderer.errors import SceneError
from renderer.scene.compiled import CompiledScene
from renderer.scene.compiled_parts import parts_of
from renderer.scene.presets import is_named
from renderer.scene.studio import STUDIO_NOTES
from worker.exchange.errors import RefusedError
from worker.process.context import WorkerContext
from worker.reading.prepare import PREVIEW
from worker.reading.relight import relight as relight_by_image
from worker.reading.relight import save_relit
from worker.work.files import place_files
from worker.work.open_scenes import mapped_scene
from worker.work.reader import ReaderFolder
from worker.work.scenes import store, store_scene

__all__ = ["relight"]

SECONDS = 300.0


def relight(worker: WorkerContext, manifest: Manifest) -> SceneInfo | None:
    """Prepares the scene with its new environment; returns None if it must be compiled in full. Raises as `prepare_scene` does.

    Of the scene's files, reads only the new environment.
    """
    known = _base_scene(worker, manifest)
    if known is None or manifest.environment is None:
        return None
    info, base, data = known
    power = info.lights_power
    assert power is not None
    light = manifest.environment
    with ReaderFolder("relight") as room:
        if is_named(light):
            made = save_relit(room.scene, light, base, data, power, room.out)
        else:  # an uploaded image
            files = [file for file in manifest.files if file.path == light]
            place_files(worker, replace(manifest, files=files), room.scene)
            room.place_base(worker, info.compiled.sha256)
            folder, base_folder, out = (os.fsencode(each) for each in (room.scene, room.base, room.out))
            job = partial(relight_by_image, folder, light, base_folder, info.compiled.sha256, power, out)
            made = room.compiled(room.run(job, light, SECONDS).get("compiled"))
        there = {part.sha256 for part in parts_of(worker.cache.path(info.compiled.sha256))}
        compiled = store_scene(worker, made, there)
        preview = store(worker, room.out / PREVIEW) if room.has_file(room.out / PREVIEW) else None
    warnings = [warning for warning in info.warnings if warning not in STUDIO_NOTES]
    return replace(info, compiled=compiled, thumbnail=None, preview=preview, warnings=warnings)


def _base_scene(worker: WorkerContext, manifest: Manifest) -> tuple[SceneInfo, CompiledScene, bytes] | None:
    """Returns the scene with its original environment: its info, its compiled scene, and the bytes of its manifest.

    Returns None if the compiled scene cannot be reused.
    """
    if manifest.base is None:
        return None
    try:
        info = SceneInfo.from_json(manifest.base)
        if info.kind != worker.kind or info.lights_power is None or not parts_of(worker.cache.path(info.compiled.sha256)):
            return None
        base = mapped_scene(worker, info.compiled.sha256)
        return info, base, worker.cache.path(info.compiled.sha256).read_bytes()
    except (ValueError, KeyError, SceneError, RefusedError, FileNotFoundError):
        return None
