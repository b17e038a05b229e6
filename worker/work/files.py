"""Puts a scene's files into a folder on this machine, and limits the memory for reading them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path, PurePosixPath

from protocol.contract import Manifest
from renderer.confine.limits import available_memory
from renderer.library_messages import library_message
from renderer.sentences import Sentence
from worker.exchange.errors import MachineError, WorkError, is_of_machine
from worker.process.apply_terms import memory_limit
from worker.process.context import WorkerContext

__all__ = ["link_or_copy", "memory_budget", "place_files"]

_LEAST_MEMORY = 1 << 30  # bytes of address space, a lower limit: less is not enough for any scene


def place_files(worker: WorkerContext, manifest: Manifest, folder: Path) -> None:
    """Links or copies the files of a scene into a folder; downloads missing ones. Raises the errors of `prepare_scene`."""
    for file in manifest.files:
        _place_blob(worker.cache.path(file.sha256, file.size), folder, file.path)


def _place_blob(blob: Path, folder: Path, name: str) -> None:
    """Links or copies a blob to the path `name` in a folder. Raises WorkError if that path leads out of the folder.

    The file name on disk is UTF-8 in any locale, as readers expect.
    """
    parts = PurePosixPath(name).parts
    if not parts or name.startswith("/") or ".." in parts or "\0" in name:
        raise WorkError(Sentence("file-path-outside-upload", "{name} leads out of the upload; rename it.", name=repr(name)))
    target = folder.joinpath(*(os.fsdecode(part.encode("utf-8", "surrogateescape")) for part in parts))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        link_or_copy(blob, target)
    except OSError as error:
        if is_of_machine(error):
            raise
        if not blob.is_file():
            raise MachineError(
                Sentence(
                    "cache-files-evicted",
                    "the cache is too small to keep the scene's files while they are needed; give it more room",
                )
            ) from error
        raise WorkError(
            Sentence(
                "file-name-not-possible",
                "{name} is not a possible file name here ({error}); rename it.",
                name=repr(name),
                error=library_message(error),
            )
        ) from error


def link_or_copy(blob: Path, target: Path) -> None:
    """Links a file if the file system supports it; otherwise copies it."""
    try:
        os.link(blob, target)
    except OSError:
        shutil.copyfile(blob, target)


def memory_budget() -> int:
    """Returns the memory limit of a process that reads one scene, in bytes.

    The limit is $RAYFARM_PREPARE_MEMORY_MB, or three quarters of the memory that is free on the machine and in the process's
    cgroups; at most the worker's own limit. Raises ValueError if the variable is not a number.
    """
    limit = memory_limit() or (1 << 60)
    if named := os.environ.get("RAYFARM_PREPARE_MEMORY_MB"):
        return min(int(named) << 20, limit)
    return min(max(available_memory() * 3 // 4, _LEAST_MEMORY), limit)
