"""Compiled scenes at the service and in this machine's cache: one file, or a manifest and its parts (renderer/scene/parts.py)."""

from __future__ import annotations

import contextlib
from pathlib import Path

from renderer.errors import SceneError
from renderer.scene.compiled import CompiledScene, load
from renderer.scene.parts import Part, parts_of
from worker.cache import BlobCache
from worker.context import WorkerContext
from worker.contract import BlobRef
from worker.errors import MachineError, is_of_machine
from worker.patience import patiently

__all__ = ["discard_damaged", "open_scene", "store", "store_scene"]

STORE_PATIENCE_S = 60.0


def store(worker: WorkerContext, path: Path) -> BlobRef:
    """Stored with patience: what came of minutes of work is not thrown away because the service starts anew."""
    return patiently(lambda: worker.link.store(path), STORE_PATIENCE_S)


def store_scene(worker: WorkerContext, path: Path) -> BlobRef:
    """Stores what `renderer.scene.compiled.save` or a Saver wrote: of the parts beside it, those that the service lacks.

    Its files are gone afterwards. What a Saver wrote for an earlier moment may be gone already.
    """
    parts = parts_of(path)
    for part in parts:
        _store_part(worker, path.parent / part.sha256, part)
    ref = store(worker, path)
    worker.cache.adopt(path, ref.sha256)
    path.unlink()
    return BlobRef(ref.path, ref.sha256, ref.size, tuple(parts))


def _store_part(worker: WorkerContext, path: Path, part: Part) -> None:
    is_new = path.is_file()
    if not patiently(lambda: worker.link.has(part.sha256), STORE_PATIENCE_S):
        store(worker, path if is_new else worker.cache.path(part.sha256, part.size))
    if is_new:
        worker.cache.adopt(path, part.sha256)
        path.unlink()


def open_scene(cache: BlobCache, sha256: str) -> CompiledScene:
    """The compiled scene, mapped; where one of the cache's files has suffered, it is fetched anew once.

    Raises SceneError where it is none, Trouble or RefusedError where it cannot be had.
    """
    try:
        return load(cache.path(sha256), cache.path)
    except SceneError:
        if not discard_damaged(cache, sha256):
            raise
    except FileNotFoundError:
        pass  # another slot made room in between
    except OSError as error:
        if not is_of_machine(error):
            raise
        raise MachineError(f"the cached scene cannot be read ({error.strerror})") from error
    return load(cache.path(sha256), cache.path)


def discard_damaged(cache: BlobCache, sha256: str) -> bool:
    """Remove of a scene's fetched files those whose bytes have changed on this disk; whether there were any."""
    found = cache.discard_damaged(sha256)
    with contextlib.suppress(SceneError, OSError):
        for part in parts_of(cache.path(sha256)):
            found |= cache.discard_damaged(part.sha256)
    return found
