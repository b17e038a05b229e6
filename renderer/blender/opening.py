"""Opens files with Blender, for this process or for a sandboxed reader process, which cannot start programs itself."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from renderer.blender.convert import convert
from renderer.blender.program import BlenderError, find
from renderer.errors import SceneError
from renderer.formats import WITHOUT_BLENDER
from renderer.sentences import Sentence

__all__ = ["callable_functions", "open_in_blender"]

MISSING = Sentence(
    "blender-required",
    "needs Blender, which is not installed here. Install it so that `blender` is on the PATH, "
    "or set RAYFARM_BLENDER to its program; `rayfarm worker --blender` downloads it for a "
    "worker",
)
SECONDS = 540.0


def open_in_blender(root: Path, name: str, out: Path) -> str:
    """Converts a file of the folder `root` with Blender into the folder `out`; returns the name of the scene file in `out`.

    Raises SceneError if Blender is not available or cannot convert the file.
    """
    try:
        blender = find()
    except BlenderError as error:
        raise SceneError(Sentence("file-fault", "{file}: {fault}", file=name, fault=error)) from None
    if blender is None:
        raise SceneError(
            Sentence(
                "blender-missing-alternative",
                "{file}: {fault}. {alternative}.",
                file=name,
                fault=MISSING,
                alternative=WITHOUT_BLENDER,
            )
        )
    return convert(blender, root, name, out, _memory(), SECONDS)


def callable_functions(scene: Path, reader_folder: Path) -> dict[str, Callable[..., Any]]:
    """Returns function name -> function of this process that a sandboxed reader may call.

    The only one, `blender`, converts a file with Blender, which has its own sandbox. scene: the folder of the scene's files.
    reader_folder: the folder that contains all of the reader's files.
    """

    def convert_with_blender(name: str, out: str) -> str:
        path, folder = (scene / name).resolve(), Path(out).resolve()
        if not path.is_relative_to(scene.resolve()) or not folder.is_relative_to(reader_folder.resolve()):
            raise SceneError(Sentence("file-not-in-scene", "{name} is not among the scene's files; add it", name=name))
        return open_in_blender(scene, name, folder)

    return {"blender": convert_with_blender}


def _memory() -> int:
    """Returns the memory limit for Blender in bytes: three quarters of the available memory."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4
    except (ValueError, OSError):
        return 8 << 30
