"""Prepare a scene under another light from all around: what is compiled of it stays, and only the environment is made anew."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from renderer.errors import SceneError
from renderer.scene.compiled import CompiledScene
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.lit import CHANGED, lit
from renderer.scene.load import light_with
from renderer.scene.parts import parts_of, save_changed
from renderer.scene.presets import is_named
from renderer.scene.studio import STUDIO_NOTES
from worker.exchange.errors import RefusedError
from worker.process.context import WorkerContext
from worker.protocol.contract import Manifest, SceneInfo
from worker.work.bounded import Send, run_bounded
from worker.work.files import memory_budget, place_files
from worker.work.render import mapped_scene
from worker.work.scenes import store_scene

__all__ = ["relight"]

SECONDS = 300.0


def relight(worker: WorkerContext, manifest: Manifest) -> SceneInfo | None:
    """What came of the scene under its light; None where it has to be compiled as any other. Raises as `prepare_scene`.

    What the manifest has in place of the scene's own light is all that is read of its files.
    """
    known = _base_of(worker, manifest)
    if known is None or manifest.environment is None:
        return None
    info, base, data = known
    power = info.lights_power
    assert power is not None
    with tempfile.TemporaryDirectory(prefix="rayfarm-relight-") as name:
        folder, out = Path(name) / "scene", Path(name) / "out"
        folder.mkdir()
        out.mkdir()
        if is_named(manifest.environment):
            made = _relit(folder, manifest.environment, base, data, power, out)
        else:  # an image that somebody uploaded
            light = manifest.environment
            file = [file for file in manifest.files if file.path == light]
            place_files(worker, replace(manifest, files=file), folder)

            def work(send: Send) -> dict[str, Any]:
                return {"manifest": str(_relit(folder, light, base, data, power, out))}

            made = Path(
                run_bounded(
                    work,
                    lambda message: None,
                    memory_bytes=memory_budget(),
                    seconds=SECONDS,
                    faults=(SceneError,),
                    subject=light,
                )["manifest"]
            )
        there = {part.sha256 for part in parts_of(worker.cache.path(info.compiled.sha256))}
        compiled = store_scene(worker, made, there)
    warnings = [warning for warning in info.warnings if warning not in STUDIO_NOTES]
    return replace(info, compiled=compiled, thumbnail=None, warnings=warnings)


def _base_of(worker: WorkerContext, manifest: Manifest) -> tuple[SceneInfo, CompiledScene, bytes] | None:
    """What is known of the scene in its own light, what it is compiled to, and the manifest of that."""
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


def _relit(folder: Path, light: str, base: CompiledScene, data: bytes, power: float, out: Path) -> Path:
    description = SceneDescription(name="light")
    light_with(SceneFiles(folder, light), light, description)
    return save_changed(data, lit(base, description, power), CHANGED, out)
