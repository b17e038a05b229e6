"""Prepares frames of a shot in a confined reader, which stays open for further frames."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from protocol.contract import FrameInfo, Manifest, PrepareFrames
from renderer.scene.compiled import CompiledScene, load
from renderer.scene.compiled_parts import parts_of
from renderer.sentences import Sentence
from worker.exchange.errors import WorkError, storage_errors
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.reading.frames import serve_requests
from worker.work.files import place_files
from worker.work.reader import ReaderFolder, translated_errors
from worker.work.scenes import store_scene

__all__ = ["compiled_frame", "forget_frames", "prepare_frames"]

SECONDS = 600.0  # below Celery's task_time_limit
PATIENCE_S = 60.0
IDLE_S = 10.0  # seconds for which a scene stays open for more frames

Answer = Callable[..., None]  # the event's type, and its further fields


class _OpenScene:
    """A scene that a confined reader of this slot has open: the reader's folder, and the compiled files of its latest frame."""

    def __init__(self, worker: WorkerContext, manifest: Manifest, work: PrepareFrames) -> None:
        """Opens a reader for the scene. Raises TemporaryError, UnfitError or RefusedError."""
        self._spent = 0.0
        self._latest: Path | None = None  # folder of the latest compiled files
        self.room = ReaderFolder("frames")
        try:
            retry_temporary(lambda: self.room.place_base(worker, work.base), PATIENCE_S)
            self.of_scene = {part.sha256 for part in parts_of(worker.cache.path(work.base))}  # kept by the service
            place_files(worker, manifest, self.room.scene)
            folder, base, out = (os.fsencode(each) for each in (self.room.scene, self.room.base, self.room.out))
            job = partial(serve_requests, folder, manifest, work, base, out, IDLE_S)
            self.reader = self.room.begin_reader(job, manifest.main, SECONDS)
        except BaseException:
            self.room.close()
            raise

    def request(self, frames: list[int], take: Callable[[dict[str, Any]], None]) -> None:
        """Requests frames from the reader, and calls `take` with each of its messages. Does nothing if the reader has ended.

        Raises WorkError and UnfitError, after which the reader has ended.
        """
        begun = time.monotonic()
        with translated_errors():
            self.reader.request({"frames": frames}, take)
        self._spent += time.monotonic() - begun
        if self._spent > SECONDS:  # the reader's CPU time limit covers all its requests
            self.reader.close()

    def keep_only(self, files: Path) -> None:
        """Deletes the compiled files of earlier frames; keeps the folder `files`, since the next frame may share its files."""
        if self._latest not in (None, files):
            shutil.rmtree(self._latest, ignore_errors=True)
        self._latest = files

    def close(self) -> None:
        """Ends the reader, and deletes its folder."""
        self.reader.close()
        self.room.close()


_open: dict[str, _OpenScene] = {}  # keyed by the request; at most one entry


def forget_frames() -> None:
    """Closes the open reader of this process, if any."""
    while _open:
        _open.popitem()[1].close()


@storage_errors()
def prepare_frames(worker: WorkerContext, manifest: Manifest, work: PrepareFrames, answer: Answer) -> None:
    """Prepares frames in order, and sends an answer for each once its compiled scene is stored at the service.

    Raises TemporaryError or RefusedError if the service or this machine cannot be used; earlier answers remain valid.
    """
    left = list(work.frames)
    opened: _OpenScene

    def handle_message(message: dict[str, Any]) -> None:
        frame = message.get("frame")
        if frame not in left:
            raise WorkError(
                Sentence(
                    "reader-frame-unexpected",
                    "{file}: its reader answered for frame {frame}, which was not requested",
                    file=manifest.main,
                    frame=str(frame)[:20],
                )
            )
        if "failed" in message:
            answer("frame-failed", frame=frame, error=message["failed"])
        else:
            ref = None
            if message["file"] is not None:
                path = opened.room.compiled(message["file"])
                ref = store_scene(worker, path, opened.of_scene)
                opened.keep_only(path.parent)
            known = (message[name] for name in ("view", "defaults", "warnings", "seconds", "views"))
            info = FrameInfo(ref, *known)
            answer("frame-prepared", frame=frame, info=asdict(info))
        left.remove(frame)

    # An equal request for the same scene, of any job, reuses the open reader.
    key = json.dumps([asdict(manifest), {**asdict(work), "work": "", "job": "", "frames": []}], sort_keys=True)
    try:
        while left:
            if key not in _open:
                forget_frames()
                _open[key] = _OpenScene(worker, manifest, work)
            opened = _open[key]
            try:
                opened.request(left, handle_message)
            finally:
                if opened.reader.is_over:
                    forget_frames()
    except WorkError as error:
        if left:
            answer("frame-failed", frame=left[0], error=str(error))  # the reader failed at this frame; the others may succeed
            answer("frames-returned", error=str(error))


def compiled_frame(worker: WorkerContext, manifest: Manifest, work: PrepareFrames) -> CompiledScene | None:
    """Returns the compiled scene of the first requested frame, for use in this process only.

    Returns None if it equals the scene compiled at the shot's start. Raises WorkError, TemporaryError or RefusedError.
    """
    found: list[str | None] = []

    def handle_message(message: dict[str, Any]) -> None:
        if "failed" in message:
            raise WorkError(message["failed"])
        found.append(message.get("file"))

    forget_frames()  # earlier requests may have removed files of an open reader
    opened = _OpenScene(worker, manifest, work)
    try:
        opened.request(work.frames[:1], handle_message)
        opened.reader.close()  # ends the reader, which could modify the validated files
        return load(opened.room.compiled(found[0])) if found and found[0] else None
    finally:
        opened.close()
