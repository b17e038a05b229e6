"""Modules and kernels that the launcher of readers loads, and its early start in parallel with the command's own imports."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

__all__ = ["PRELOAD", "begin"]

PRELOAD = (
    *("rayfarm.reader_jobs", "renderer.preparation_kernels:prepare"),
    # Kernels of readers, which those import only for files of their format.
    *("renderer.scene.readers.obj_lines", "renderer.scene.readers.threemf_rows", "renderer.scene.readers.gltf.deform"),
)
_READING = ("info", "render")


def begin(words: Sequence[str]) -> None:
    """Starts the launcher of readers if the typed command reads a scene. A failure is reported later by the command."""
    if words[:1] and words[0] in _READING and not {"-h", "--help"} & set(words):
        from renderer.confine.running import begin_launcher
        from renderer.errors import MachineError

        with contextlib.suppress(MachineError):
            begin_launcher(PRELOAD)
