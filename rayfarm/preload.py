"""Processes that a command starts before its own imports, so that their imports run at the same time.

Commands that read scenes start the launcher of confined readers; `up` and `worker` start the processes of the farm.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

__all__ = ["PRELOAD", "start_preloading"]

PRELOAD = (
    *("rayfarm.reader_jobs", "renderer.preparation_kernels:prepare"),
    # Kernels of readers, which those import only for files of their format.
    *("renderer.scene.readers.obj_lines", "renderer.scene.readers.threemf_rows", "renderer.scene.readers.gltf.deform"),
)
_SCENE_COMMANDS = ("info", "render", "husk")
_FARM_COMMANDS = {"up": ("service.standby", "worker.standby"), "worker": ("worker.standby",)}


def start_preloading(words: Sequence[str]) -> None:
    """Starts the processes that the command on the command line will need. The command reports failures later."""
    if {"-h", "--help"} & set(words):
        return
    if words[:1] and words[0] in _FARM_COMMANDS:
        from rayfarm.local import early

        early.start_processes(_FARM_COMMANDS[words[0]])
    elif words[:1] and words[0] in _SCENE_COMMANDS:
        from renderer.confine.running import begin_launcher
        from renderer.errors import MachineError

        with contextlib.suppress(MachineError):
            begin_launcher(PRELOAD)
