"""The compiled scenes that a slot has mapped, and a thread that maps the next batch's while the slot renders."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from functools import partial
from typing import Any, Self

from renderer.scene.compiled import CompiledScene
from worker.exchange.polling_thread import PollingThread
from worker.process.context import WorkerContext
from worker.work.scenes import open_scene

__all__ = ["SceneOpener", "is_mapped", "mapped_scene"]

# Number of mapped scenes that a slot keeps open. They cost address space; their pages are shared among slots.
OPEN_SCENES = 8

log = logging.getLogger(__name__)

_open: OrderedDict[str, CompiledScene] = OrderedDict()
_opening: dict[str, threading.Lock] = {}  # scenes that a thread maps at present, and for which others wait
_lock = threading.Lock()  # of both, held only for moments


def mapped_scene(worker: WorkerContext, sha256: str) -> CompiledScene:
    """Returns the compiled scene with this hash. Each slot maps it once. Thread-safe: no scene waits for another's download.

    Raises SceneError if it is not a compiled scene, TemporaryError or RefusedError if it cannot be downloaded.
    """
    if (scene := _mapped(sha256)) is not None:
        return scene
    with _lock:
        opening = _opening.setdefault(sha256, threading.Lock())
    with opening:
        if (scene := _mapped(sha256)) is not None:  # by the thread for which this one has waited
            return scene
        try:
            scene = open_scene(worker.cache, sha256)
            with _lock:
                _open[sha256] = scene
                if len(_open) > OPEN_SCENES:
                    _open.popitem(last=False)
        finally:
            with _lock:
                _opening.pop(sha256, None)
        return scene


def _mapped(sha256: str) -> CompiledScene | None:
    with _lock:
        scene = _open.get(sha256)
        if scene is not None:
            _open.move_to_end(sha256)
        return scene


def is_mapped(sha256: Any) -> bool:
    """Returns True if the slot has mapped the scene with this hash, so that `mapped_scene` returns it at once."""
    return isinstance(sha256, str) and sha256 in _open


class SceneOpener:
    """Context manager with a thread that maps scenes before they are needed.

    The thread ends with the context, so none runs when the slot forks a reader.
    """

    def __init__(self, worker: WorkerContext) -> None:
        self._worker = worker
        self._thread = PollingThread("scene")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.close()

    def open(self, sha256: Any) -> None:
        """Lets the thread map a scene, named by its hash, unless it is mapped.

        Errors are only logged: the batch maps the scene again, and reports them.
        """
        if not is_mapped(sha256):
            self._thread.submit(partial(self._open, sha256))

    def _open(self, sha256: Any) -> None:
        try:
            mapped_scene(self._worker, sha256)
        except Exception as error:
            log.debug("a scene cannot be opened in advance: %s", error)
