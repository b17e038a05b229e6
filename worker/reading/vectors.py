"""Motion vectors of a frame, computed from the scene at the frame's time and at the times of the neighbouring frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from protocol.contract import FrameVectors, Manifest
from renderer.cameras import camera_number
from renderer.confine.reader import Link
from renderer.frames import frame_number
from renderer.scene.animation import BETWEEN, Moment
from renderer.scene.animation.orbit import orbit, orbit_over
from renderer.scene.compile import AUTO_CAMERA, compile_scene, own_cameras, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot
from renderer.settings import RenderSettings, View
from renderer.variation import Variation
from renderer.vectors import motion_vectors
from worker.reading.scene_folder import folder_of

__all__ = ["vectors"]


def vectors(folder: bytes, manifest: Manifest, work: FrameVectors, result: bytes, link: Link) -> dict[str, Any]:
    """Writes the motion vectors of a frame as float32 to the file `result`. Raises RayfarmError.

    folder: path of the scene's files. work: the frame, its size and its view. link: connection to the slot.
    """
    variation = None if work.vary is None else Variation.parse(work.vary)
    placed = manifest.environment, manifest.variant, manifest.up, manifest.floor
    shot = Shot(folder_of(folder), manifest.main, *placed, variation)
    moment = Moment(frame_number(work.frame), work.fps, work.clip)
    read = shot.between_frames(moment)
    fps, up = read.fps, read.up
    compiled = compile_scene(read)
    view, views = _views(shot, read, compiled, work)
    if work.turntable is not None:
        views = orbit_over(view, views, moment, BETWEEN, fps, work.turntable, up)
        view = orbit(view, moment.seconds(fps) / work.turntable, up)
    settings = RenderSettings(work.width, work.height, view, views=views)
    motion_vectors(compiled, settings).astype("<f4").tofile(folder_of(result))
    return {}


def _views(shot: Shot, described: SceneDescription, compiled: CompiledScene, work: FrameVectors) -> tuple[View, tuple[View, ...]]:
    """Returns the frame's view; if its camera moves, also its views at the times of the previous, this and the next frame."""
    if work.view is not None:
        return _view(work.view), ()
    cameras = own_cameras(described, compiled)
    number = camera_number([*(camera.name for camera in cameras), AUTO_CAMERA], work.camera)
    if number < len(cameras):
        return cameras[number].view, cameras[number].keys
    if work.clip is None:
        return _view(work.auto), ()
    start = shot.unvaried_at(replace(Moment(shot.start), fps=work.fps, clip=work.clip))
    return View.from_json(summarise(start, compile_scene(start))["cameras"][-1]["view"]), ()


def _view(view: dict[str, Any]) -> View:
    return View.from_json({name: value for name, value in view.items() if value is not None})
