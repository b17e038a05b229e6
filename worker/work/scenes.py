"""Uploads compiled scenes to the service, and opens those in this machine's cache.

A compiled scene is a single file, or a manifest and its parts (renderer/scene/compiled_parts.py).
"""

from __future__ import annotations

import contextlib
from collections import OrderedDict
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from protocol.contract import BlobRef
from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.compiled import CompiledScene, load
from renderer.scene.compiled_parts import Part, parts_of
from renderer.sentences import Sentence
from worker.exchange.cache import BlobCache
from worker.exchange.errors import MachineError, RefusedError, is_of_machine
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext

__all__ = ["discard_damaged", "open_scene", "scene_not_fetched", "store", "store_scene"]

STORE_TIMEOUT_S = 60.0
SMALL_BYTES = 256 << 10  # a file of at most this size that this slot has not sent yet is sent without asking for it
SENDING_THREADS = 4
MAX_KNOWN = 4096  # hashes of sent files

_sent: OrderedDict[str, None] = OrderedDict()  # the latest, by hash


def scene_not_fetched(worker: WorkerContext, error: RefusedError) -> Sentence:
    """Returns the sentence for a scene that the service does not give to this worker."""
    return Sentence("worker-scene-not-fetched", "{worker} cannot fetch the scene: {error}", worker=worker.name, error=error)


def store(worker: WorkerContext, path: Path) -> BlobRef:
    """Uploads a file to the service, with retries, so that a restart of the service does not lose minutes of work."""
    ref = retry_temporary(lambda: worker.link.store(path), STORE_TIMEOUT_S)
    _sent[ref.sha256] = None
    if len(_sent) > MAX_KNOWN:
        _sent.popitem(last=False)
    return ref


def store_scene(worker: WorkerContext, path: Path, stored_parts: Collection[str] = ()) -> BlobRef:
    """Uploads a compiled scene, but only those parts that the service lacks.

    path: the scene, written by `renderer.scene.compiled.save` or a Saver. stored_parts: hashes of parts that the service
    certainly has; they are not checked. Also adds the parts to this machine's cache, for later frames that share them. Raises
    TemporaryError if a part of an earlier frame no longer exists.
    """
    parts = parts_of(path)
    unknown = [part for part in dict.fromkeys(parts) if part.sha256 not in stored_parts]
    if unknown:  # together, since the service waits for its disk with each
        with ThreadPoolExecutor(min(len(unknown), SENDING_THREADS), "parts") as threads:
            list(threads.map(lambda part: _store_part(worker, path.parent / part.sha256, part), unknown))
    if parts and _is_stored(worker, path.name, path):
        ref = BlobRef("", path.name, path.stat().st_size)
    else:
        ref = store(worker, path)
    worker.cache.add_copy(path, ref.sha256)
    return BlobRef(ref.path, ref.sha256, ref.size, tuple(parts))


def _store_part(worker: WorkerContext, path: Path, part: Part) -> None:
    if not _is_stored(worker, part.sha256, path):
        store(worker, path if path.is_file() else _from_cache(worker, part))
    if path.is_file():
        worker.cache.add_copy(path, part.sha256)


def _is_stored(worker: WorkerContext, sha256: str, path: Path) -> bool:
    """Returns True if the service has a file, which it then keeps.

    Returns False without a request if the file `path` exists, is small, and was not sent by this slot.
    """
    if sha256 not in _sent and path.is_file() and path.stat().st_size <= SMALL_BYTES:
        return False
    return retry_temporary(lambda: worker.link.has_blob(sha256), STORE_TIMEOUT_S)


def _from_cache(worker: WorkerContext, part: Part) -> Path:
    try:
        return worker.cache.path(part.sha256, part.size)
    except RefusedError as error:
        raise MachineError(
            Sentence("compiled-part-gone", "a part of a compiled scene is missing; it is compiled again")
        ) from error


def open_scene(cache: BlobCache, sha256: str) -> CompiledScene:
    """Maps a compiled scene. If a cached file is damaged, downloads it again once.

    Raises SceneError if it is not a compiled scene, TemporaryError or RefusedError if it cannot be downloaded.
    """
    try:
        return load(cache.path(sha256), cache.path)
    except SceneError:
        if not discard_damaged(cache, sha256):
            raise
    except FileNotFoundError:
        pass  # evicted by another slot
    except OSError as error:
        if not is_of_machine(error):
            raise
        raise MachineError(
            Sentence("cached-scene-unreadable", "the cached scene cannot be read ({error})", error=library_message(error))
        ) from error
    return load(cache.path(sha256), cache.path)


def discard_damaged(cache: BlobCache, sha256: str) -> bool:
    """Deletes downloaded files of a scene whose content does not match their hash. Returns whether there were any."""
    found = cache.discard_damaged(sha256)
    with contextlib.suppress(SceneError, OSError):
        for part in parts_of(cache.path(sha256)):
            found |= cache.discard_damaged(part.sha256)
    return found
