"""Prepare frames of a shot: files are opened and pictures decoded once for all of them, and only what moves is compiled anew."""

from __future__ import annotations

import copy
import itertools
import json
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from renderer.cameras import camera_number
from renderer.errors import RayfarmError
from renderer.frames import frame_number
from renderer.scene.animation import Moment, Shutter
from renderer.scene.animation.orbit import orbit, orbit_over
from renderer.scene.compile import AUTO_CAMERA, compile_scene, own_cameras, summarise
from renderer.scene.compiled import CompiledScene, load
from renderer.scene.description import SceneDescription
from renderer.scene.kept import Kept
from renderer.scene.load import Shot
from renderer.scene.parts import Saver, parts_of
from renderer.scene.same import compiles_alike
from renderer.settings import View, chosen
from worker.exchange.errors import MachineError, WorkError, is_of_machine
from worker.exchange.patience import patiently
from worker.process.context import WorkerContext
from worker.protocol.contract import FrameInfo, Manifest, PrepareFrames
from worker.work.bounded import Bounds, Send
from worker.work.files import memory_budget, place_files
from worker.work.render import mapped_scene
from worker.work.scenes import store_scene
from worker.work.standing import Standing

__all__ = ["forget_frames", "prepare_frames", "see_frame"]

SECONDS = 600.0  # below Celery's task_time_limit
PATIENCE_S = 60.0
IDLE_S = 10.0  # that a scene stays open for more of its frames

Answer = Callable[..., None]  # the type of an event, and more of it


class _Open:
    """A scene that a child of this slot has open: its files, what came of it last, and the child."""

    def __init__(self, worker: WorkerContext, manifest: Manifest, work: PrepareFrames) -> None:
        """Raises Trouble or RefusedError."""
        base = patiently(lambda: mapped_scene(worker, work.base), PATIENCE_S)
        self._latest: Path | None = None  # the files of what was compiled last
        self.of_scene = {part.sha256 for part in parts_of(worker.cache.path(work.base))}  # the service has them while it has that
        self._room = tempfile.TemporaryDirectory(prefix="rayfarm-frames-", ignore_cleanup_errors=True)
        room = Path(self._room.name)
        folder, out = room / "scene", room / "out"
        out.mkdir()
        place_files(worker, manifest, folder)
        bounds = Bounds(memory_budget(), SECONDS, (RayfarmError,), manifest.main)
        leave = partial(shutil.rmtree, room, ignore_errors=True)
        self.child = Standing(lambda: _answer(folder, manifest, work, base, out), leave, bounds, IDLE_S)

    def keep(self, files: Path) -> None:
        """Of what was compiled for frames these files alone: the next frame may be the same."""
        if self._latest not in (None, files):
            shutil.rmtree(self._latest, ignore_errors=True)
        self._latest = files

    def close(self) -> None:
        """Let go of it."""
        self.child.end()
        self._room.cleanup()


_open: dict[str, _Open] = {}  # by what they have open; at most one


def forget_frames() -> None:
    """Let go of what a child of this process has open."""
    while _open:
        _open.popitem()[1].close()


def prepare_frames(worker: WorkerContext, manifest: Manifest, work: PrepareFrames, answer: Answer) -> None:
    """Prepare frames in their order, and answer for each as soon as what came of it is stored at the service.

    Raises Trouble or RefusedError where the service or this machine cannot be used; what was answered stays.
    """
    left = list(work.frames)
    opened: _Open

    def take(message: dict[str, Any]) -> None:
        frame = message["frame"]
        if "failed" in message:
            answer("frame-failed", frame=frame, error=message["failed"])
        else:
            ref = None
            if message["file"] is not None:
                path = Path(message["file"])
                ref = store_scene(worker, path, opened.of_scene)
                opened.keep(path.parent)
            known = (message[name] for name in ("view", "defaults", "warnings", "seconds", "views"))
            info = FrameInfo(ref, *known)
            answer("frame-prepared", frame=frame, info=asdict(info))
        left.remove(frame)

    # Whoever asks for the same of the same scene, for whichever job, finds it open.
    key = json.dumps([asdict(manifest), {**asdict(work), "work": "", "job": "", "frames": []}], sort_keys=True)
    try:
        while left:
            if key not in _open:
                forget_frames()
                _open[key] = _Open(worker, manifest, work)
            opened = _open[key]
            try:
                opened.child.ask({"frames": left}, take)
            finally:
                if opened.child.is_over:
                    forget_frames()
    except WorkError as error:
        if left:
            answer("frame-failed", frame=left[0], error=str(error))  # it was at this one; the others may be better
            answer("frames-returned", error=str(error))
    except OSError as error:
        if not is_of_machine(error):
            raise
        raise MachineError(f"this machine cannot keep a scene's files ({error.strerror}: {error.filename})") from error


def see_frame(worker: WorkerContext, manifest: Manifest, work: PrepareFrames) -> CompiledScene | None:
    """What the scene is at the first of the frames, for this process alone: None where that is what it is compiled to at its
    beginning. Raises WorkError, Trouble or RefusedError.
    """
    found: list[CompiledScene | None] = []

    def take(message: dict[str, Any]) -> None:
        if "failed" in message:
            raise WorkError(message["failed"])
        file = message["file"]
        found.append(load(Path(file)) if file else None)

    forget_frames()  # the files of a child that others asked before may be gone in part
    opened = _Open(worker, manifest, work)
    try:
        opened.child.ask({"frames": work.frames[:1]}, take)
    finally:
        opened.close()
    return found[0]


def _answer(
    folder: Path, manifest: Manifest, work: PrepareFrames, base: CompiledScene, out: Path
) -> Callable[[dict[str, Any], Send], None]:
    """In the bounded child: what says of each frame what came of it, or under `failed` why nothing did."""
    begun = time.monotonic()
    stage = _Stage(Shot(folder, manifest.main, manifest.environment, manifest.variant), work, base, out)
    opened_s = time.monotonic() - begun

    def answer(request: dict[str, Any], send: Send) -> None:
        nonlocal opened_s
        for frame in request["frames"]:
            begun = time.monotonic()
            try:
                said = stage.at(Moment(frame_number(frame), work.fps, work.clip))
            except RayfarmError as error:
                said = {"failed": str(error)}  # an `error` would end the child
            send({"frame": frame, "seconds": time.monotonic() - begun + opened_s, **said})
            opened_s = 0.0

    return answer


class _Stage:
    """A scene over time. What it is at a moment does not depend on the moments asked for before."""

    def __init__(self, shot: Shot, work: PrepareFrames, base: CompiledScene, out: Path) -> None:
        self._shot = shot
        self._work = work
        self._base = base
        self._kept = Kept()
        self._saver = Saver(out)
        # Each moment's files lie in a folder of their own: another that looks the same may be written while these are let go of.
        self._rooms = (out / str(number) for number in itertools.count())
        self._start = shot.at(Moment(shot.start))
        self._last: tuple[SceneDescription, CompiledScene, Path] | None = None  # good until another moment is compiled
        self._auto: View | None = View.from_json(_given(work.base_auto)) if work.clip is None else None
        self._still: SceneDescription | None = None  # what does not move is read once

    def at(self, moment: Moment) -> dict[str, Any]:
        """What is to be said of a frame. Raises SceneError, and SettingsError where its view cannot be."""
        read = self._still or self._shot.over(moment, self._work.shutter)
        self._still = None if read.moves else read
        described, compiled, file = self._compiled(read)
        view, views = self._views(described, compiled)
        if self._work.turntable is not None:
            fps, up = described.fps, described.up
            shutter = Shutter.of(chosen(self._work.shutter, described.defaults))
            views = orbit_over(view, views, moment, shutter, fps, self._work.turntable, up)
            view = orbit(view, moment.seconds(fps) / self._work.turntable, up)
        return {
            "file": file and str(file),
            "view": view.to_json(),
            "views": [each.to_json() for each in views],
            "defaults": dict(described.defaults),
            "warnings": list(described.warnings),
        }

    def _compiled(self, read: SceneDescription) -> tuple[SceneDescription, CompiledScene, Path | None]:
        """The description, what it compiles to, and the file of that; None where that is the base's."""
        if compiles_alike(read, self._start):
            return read, self._base, None
        if self._last is not None and compiles_alike(read, self._last[0]):
            return read, *self._last[1:]
        untouched = _untouched(read)
        self._last = None
        kept, self._kept = self._kept, Kept()  # what was being made when a moment failed is not trusted
        compiled = compile_scene(read, kept=kept)
        assert kept.cuts is not None
        room = next(self._rooms)
        room.mkdir()
        file = self._saver.save(compiled, kept.cuts, room)
        self._kept = kept
        self._last = untouched, compiled, file
        return read, compiled, file

    def _views(self, description: SceneDescription, compiled: CompiledScene) -> tuple[View, tuple[View, ...]]:
        """The view that the request names: its own, or a camera of the scene as it stands at the moment, and of one that moves
        while the shutter is open its keys."""
        if self._work.view is not None:
            return View.from_json(_given(self._work.view)), ()
        cameras = own_cameras(description, compiled)
        number = camera_number([*(c.name for c in cameras), AUTO_CAMERA], self._work.camera)
        return (cameras[number].view, cameras[number].keys) if number < len(cameras) else (self._auto_view(), ())

    def _auto_view(self) -> View:
        """The camera that frames the scene stands as it does at the beginning; of another clip, at its own."""
        if self._auto is None:
            read = self._shot.at(Moment(self._shot.start, self._work.fps, self._work.clip))
            if compiles_alike(read, self._start):
                self._auto = View.from_json(_given(self._work.base_auto))
            else:
                self._auto = View.from_json(summarise(read, compile_scene(read))["cameras"][-1]["view"])
        return self._auto


def _untouched(description: SceneDescription) -> SceneDescription:
    """A copy that compiling the description leaves as it is: that may add to its lists, and changes nothing in them."""
    held = {f.name: getattr(description, f.name) for f in fields(description)}
    copied: dict[str, Any] = {name: copy.copy(value) for name, value in held.items() if isinstance(value, list | dict)}
    return replace(description, **copied)


def _given(view: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in view.items() if value is not None}
