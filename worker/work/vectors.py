"""Motion vectors of a frame: the scene is read at its time and at those of its neighbours, in a bounded child; the result is a
blob."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from renderer.cameras import camera_number
from renderer.errors import RayfarmError
from renderer.frames import frame_number
from renderer.scene.animation import BETWEEN, Moment
from renderer.scene.animation.orbit import orbit, orbit_over
from renderer.scene.compile import AUTO_CAMERA, compile_scene, own_cameras, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot
from renderer.settings import RenderSettings, View
from renderer.vectors import load_kernel, motion_vectors
from worker.exchange.patience import patiently
from worker.process.context import WorkerContext
from worker.protocol.contract import FrameVectors, Manifest
from worker.work.bounded import run_bounded
from worker.work.files import memory_budget, place_files

__all__ = ["frame_vectors"]

SECONDS = 550.0  # below what the service waits
PATIENCE_S = 30.0  # somebody waits for them


def frame_vectors(worker: WorkerContext, work: FrameVectors) -> dict[str, Any]:
    """The blob of the vectors. Raises WorkerError and OSError."""
    manifest = patiently(lambda: worker.link.manifest(work.scene), PATIENCE_S)
    load_kernel()  # here, so that the next child has it
    with tempfile.TemporaryDirectory(prefix="rayfarm-vectors-") as name:
        folder, result = Path(name) / "scene", Path(name) / "vectors.f32"
        place_files(worker, manifest, folder)
        run_bounded(
            lambda send: _work(folder, manifest, work, result),
            lambda message: None,
            memory_bytes=memory_budget(),
            seconds=SECONDS,
            faults=(RayfarmError,),
            subject=manifest.main,
        )
        blob = patiently(lambda: worker.link.store(result), PATIENCE_S)
    return {"sha256": blob.sha256}


def _work(folder: Path, manifest: Manifest, work: FrameVectors, result: Path) -> dict[str, Any]:
    """In the bounded child."""
    shot = Shot(folder, manifest.main, manifest.environment, manifest.variant)
    moment = Moment(frame_number(work.frame), work.fps, work.clip)
    read = shot.between(moment)
    fps, up = read.fps, read.up
    compiled = compile_scene(read)
    view, views = _views(shot, read, compiled, work)
    if work.turntable is not None:
        views = orbit_over(view, views, moment, BETWEEN, fps, work.turntable, up)
        view = orbit(view, moment.seconds(fps) / work.turntable, up)
    settings = RenderSettings(work.width, work.height, view, views=views)
    motion_vectors(compiled, settings).astype("<f4").tofile(result)
    return {}


def _views(shot: Shot, described: SceneDescription, compiled: CompiledScene, work: FrameVectors) -> tuple[View, tuple[View, ...]]:
    """The view that the request names, and of a camera that moves those of the three moments."""
    if work.view is not None:
        return _view(work.view), ()
    cameras = own_cameras(described, compiled)
    number = camera_number([*(camera.name for camera in cameras), AUTO_CAMERA], work.camera)
    if number < len(cameras):
        return cameras[number].view, cameras[number].keys
    if work.clip is None:
        return _view(work.auto), ()
    start = shot.at(replace(Moment(shot.start), fps=work.fps, clip=work.clip))
    return View.from_json(summarise(start, compile_scene(start))["cameras"][-1]["view"]), ()


def _view(view: dict[str, Any]) -> View:
    return View.from_json({name: value for name, value in view.items() if value is not None})
