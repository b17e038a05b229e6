"""The temporary folder of one job, the only folder to which its reader may write."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from renderer.confine.limits import available_memory
from renderer.errors import MachineError
from renderer.library_messages import library_message
from renderer.sentences import Sentence

__all__ = ["temporary_folder"]

_MEMORY = Path("/dev/shm")


@contextmanager
def temporary_folder(prefix: str, in_memory: bool = False) -> Iterator[Path]:
    """Context manager that creates a temporary folder and deletes it at the end.

    in_memory: creates the folder in shared memory (/dev/shm) if that has enough space for a large scene. Raises MachineError if
    no temporary folder is writable.
    """
    folder = _create_folder(prefix, _MEMORY if in_memory and _has_enough_memory(_MEMORY) else None)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _create_folder(prefix: str, where: Path | None) -> Path:
    tried = []
    for parent in dict.fromkeys((where, None, _MEMORY)):
        if parent is _MEMORY and not parent.is_dir():
            continue
        try:
            return Path(tempfile.mkdtemp(prefix=prefix, dir=parent)).resolve()
        except OSError as error:
            folder = parent or os.environ.get("TMPDIR")
            reason = library_message(error)
            tried.append(
                Sentence("folder-with-reason", "{folder}: {reason}", folder=folder, reason=reason)
                if folder
                else Sentence("default-folder-with-reason", "the default folder: {reason}", reason=reason)
            )
    raise MachineError(
        Sentence(
            "temporary-folder-missing",
            "this machine has no writable folder for temporary files ({tried}). Set TMPDIR to one.",
            tried=tried,
        )
    )


def _has_enough_memory(folder: Path) -> bool:
    """Returns True if the shared memory file system of this folder has room for half of the available memory.

    A container's default of 64 MiB is too small.
    """
    try:
        found = os.statvfs(folder)
    except OSError:
        return False
    return os.access(folder, os.W_OK) and found.f_bavail * found.f_frsize >= available_memory() // 2
