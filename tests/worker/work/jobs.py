"""Jobs that the worker's tests run in confined reader processes. link: a job's connection to the process that started it."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
from pathlib import Path
from typing import Any

from renderer.confine.reader import Link
from renderer.scene.animation import Moment
from worker.reading import frames

__all__ = ["crash_at_frame_1", "link_out", "raise_disk_full", "return_answer"]


def crash_at_frame_1(*given: Any) -> dict[str, Any]:
    """Prepares frames like the real reader process, but crashes at frame 1, by reading memory address 0."""
    at = frames.OpenScene.frame_message

    def crashing(stage: frames.OpenScene, moment: Moment) -> dict[str, Any]:
        return {"read": ctypes.string_at(0)} if moment.frame == 1 else at(stage, moment)

    frames.OpenScene.frame_message = crashing  # type: ignore[method-assign]
    return frames.serve_requests(*given)


def return_answer(answer: dict[str, Any], link: Link) -> dict[str, Any]:
    """Returns the given answer to the process that started the job."""
    return answer


def raise_disk_full(link: Link) -> dict[str, Any]:
    """Raises the OSError of a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "compiled")


def link_out(scene: bytes, out: bytes, link: Link) -> dict[str, Any]:
    """Tries to get a file of the scene's folder into `out` by symbolic link, hard link and move.

    Returns {"made": names of the attempts that succeeded}. scene, out: paths of the folders as bytes.
    """
    source, made = Path(os.fsdecode(scene)) / "a", []
    for name, way in (("symbolic", os.symlink), ("hard", os.link), ("moved", os.rename)):
        with contextlib.suppress(OSError):
            way(source, Path(os.fsdecode(out)) / name)
            made.append(name)
    return {"made": made}
