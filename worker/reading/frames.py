"""Compiles frames of a shot (an animated scene): reads each file once, and compiles only what moves for each frame."""

from __future__ import annotations

import copy
import itertools
import shutil
import time
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from protocol.contract import Manifest, PrepareFrames
from renderer.cameras import camera_number
from renderer.confine.reader import Link, Send
from renderer.errors import MachineError, RayfarmError
from renderer.frames import frame_number
from renderer.scene.animation import Moment, Shutter
from renderer.scene.animation.orbit import orbit, orbit_over
from renderer.scene.compile import AUTO_CAMERA, compile_scene, own_cameras, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.compiled_parts import Saver
from renderer.scene.description import SceneDescription
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import Shot
from renderer.scene.scene_equality import compiles_alike
from renderer.settings import View, chosen
from renderer.variation import Variation
from worker.reading.scene_folder import folder_of, mapped_scene

__all__ = ["OpenScene", "frame_answerer", "serve_requests"]


def serve_requests(
    folder: bytes, manifest: Manifest, work: PrepareFrames, base_folder: bytes, out: bytes, idle_s: float, link: Link
) -> dict[str, Any]:
    """Compiles the frames that the slot requests, until no request comes for `idle_s` seconds; then empties the folder `out`.

    folder: the scene's files. work: the shot's settings, and the hash of the scene compiled at its start, which is in
    `base_folder`. link: connection to the slot.
    """
    answer = frame_answerer(folder_of(folder), manifest, work, mapped_scene(base_folder, work.base), folder_of(out))
    for request in link.requests(idle_s):
        answer(request["frames"], link.send)
    for path in folder_of(out).iterdir():
        shutil.rmtree(path, ignore_errors=True)
    return {}


def frame_answerer(
    folder: Path, manifest: Manifest, work: PrepareFrames, base: CompiledScene, out: Path
) -> Callable[[list[int], Send], None]:
    """Returns a function that compiles the given frames, and sends for each its result, or its error as `failed`.

    base: the scene compiled at the shot's start. out: folder for compiled scenes.
    """
    begun = time.monotonic()
    variation = None if work.vary is None else Variation.parse(work.vary)
    placed = manifest.environment, manifest.variant, manifest.up, manifest.floor
    shot = Shot(folder, manifest.main, *placed, variation)
    stage = OpenScene(shot, work, base, out)
    opened_s = time.monotonic() - begun

    def answer_frames(frames: list[int], send: Send) -> None:
        nonlocal opened_s
        for frame in frames:
            begun = time.monotonic()
            try:
                found = stage.frame_message(Moment(frame_number(frame), work.fps, work.clip))
            except MachineError:
                raise
            except RayfarmError as error:
                found = {"failed": str(error)}  # the key `error` would end this process
            send({"frame": frame, "seconds": time.monotonic() - begun + opened_s, **found})
            opened_s = 0.0

    return answer_frames


class OpenScene:
    """A scene over time. A frame's result does not depend on which frames were compiled before."""

    def __init__(self, shot: Shot, work: PrepareFrames, base: CompiledScene, out: Path) -> None:
        self._shot = shot
        self._work = work
        self._base = base
        self._kept = ShotCache()
        self._saver = Saver(out)
        self._out = out
        # Each moment has a separate folder: an equal moment may be written while these files are being deleted.
        self._rooms = (out / str(number) for number in itertools.count())
        self._start = shot.unvaried_at(Moment(shot.start))
        self._last: tuple[SceneDescription, CompiledScene, Path] | None = None  # valid until another moment is compiled
        self._auto: View | None = View.from_json(_without_none(work.base_auto)) if work.clip is None else None
        self._still: SceneDescription | None = None  # the description of a static scene, read once

    def frame_message(self, moment: Moment) -> dict[str, Any]:
        """Compiles the scene at a moment. Returns the message about it: file, view, motion keys, defaults and warnings.

        Raises SceneError, and SettingsError if the frame's view is invalid.
        """
        read = self._still or self._shot.over_shutter(moment, self._work.shutter)
        self._still = None if read.moves else read
        described, compiled, file = self._compiled(read)
        view, views = self._views(described, compiled)
        if self._work.turntable is not None:
            fps, up = described.fps, described.up
            shutter = Shutter.from_settings(chosen(self._work.shutter, described.defaults))
            views = orbit_over(view, views, moment, shutter, fps, self._work.turntable, up)
            view = orbit(view, moment.seconds(fps) / self._work.turntable, up)
        return {
            "file": file and file.relative_to(self._out).as_posix(),
            "view": view.to_json(),
            "views": [each.to_json() for each in views],
            "defaults": dict(described.defaults),
            "warnings": list(described.warnings),
        }

    def _compiled(self, read: SceneDescription) -> tuple[SceneDescription, CompiledScene, Path | None]:
        """Returns the scene description, its compiled scene, and the compiled scene's file.

        The file is None if the compiled scene equals the one at the shot's start.
        """
        if compiles_alike(read, self._start):
            return read, self._base, None
        if self._last is not None and compiles_alike(read, self._last[0]):
            return read, *self._last[1:]
        untouched = _copied_description(read)
        self._last = None
        kept, self._kept = self._kept, ShotCache()  # discard the cache if compiling fails
        compiled = compile_scene(read, shot_cache=kept)
        assert kept.cuts is not None
        room = next(self._rooms)
        room.mkdir()
        file = self._saver.save(compiled, kept.cuts, room)
        self._kept = kept
        self._last = untouched, compiled, file
        return read, compiled, file

    def _views(self, description: SceneDescription, compiled: CompiledScene) -> tuple[View, tuple[View, ...]]:
        """Returns the view to render, and its motion keys: views at times within the shutter, none if the camera does not move.

        The view is the one requested, or else a camera of the scene.
        """
        if self._work.view is not None:
            return View.from_json(_without_none(self._work.view)), ()
        cameras = own_cameras(description, compiled)
        number = camera_number([*(c.name for c in cameras), AUTO_CAMERA], self._work.camera)
        return (cameras[number].view, cameras[number].keys) if number < len(cameras) else (self._auto_view(), ())

    def _auto_view(self) -> View:
        """Returns the view of the automatic camera. It does not move, and frames the scene at the start of the clip."""
        if self._auto is None:
            read = self._shot.unvaried_at(Moment(self._shot.start, self._work.fps, self._work.clip))
            if compiles_alike(read, self._start):
                self._auto = View.from_json(_without_none(self._work.base_auto))
            else:
                self._auto = View.from_json(summarise(read, compile_scene(read))["cameras"][-1]["view"])
        return self._auto


def _copied_description(description: SceneDescription) -> SceneDescription:
    """Returns a copy of the description with lists of its own, since compiling a description appends to its lists."""
    held = {f.name: getattr(description, f.name) for f in fields(description)}
    copied: dict[str, Any] = {name: copy.copy(value) for name, value in held.items() if isinstance(value, list | dict)}
    return replace(description, **copied)


def _without_none(view: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in view.items() if value is not None}
