""".blend and Alembic files, which Blender opens: as a scene of ours that it writes in a process of its own."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path

from renderer.blender.convert import convert
from renderer.blender.program import BlenderError, find
from renderer.confine.reader import call, is_reader
from renderer.errors import SceneError
from renderer.formats import WITHOUT_BLENDER
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers import yaml

__all__ = ["open_in_blender", "read"]

MISSING = (
    "is opened by Blender, and there is none here. Install it so that `blender` is on the PATH, or set RAYFARM_BLENDER to its "
    "program; `rayfarm worker --blender` fetches one for a worker"
)
SECONDS = 540.0


class _Written:
    """What Blender wrote of a file, for as long as somebody holds it."""

    def __init__(self, files: SceneFiles, name: str) -> None:
        """Raises SceneError."""
        path = files.path(name)
        root = path.parents[len(Path(name).parts) - 1]
        folder = Path(tempfile.mkdtemp(prefix="rayfarm-blend-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        if is_reader():  # which starts no programs
            self.main = str(call("blender", name=name, out=str(folder)))
        else:
            self.main = open_in_blender(root, name, folder)
        self.files = SceneFiles(folder)


def open_in_blender(root: Path, name: str, out: Path) -> str:
    """Has Blender write the scene in a file of the folder `root` into the folder `out`; returns the main file's name there.

    Raises SceneError.
    """
    try:
        blender = find()
    except BlenderError as error:
        raise SceneError(f"{name}: {error}") from None
    if blender is None:
        raise SceneError(f"{name}: {MISSING}. Or {WITHOUT_BLENDER}.")
    return convert(blender, root, name, out, _memory(), SECONDS)


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds what such a file shows at a moment to the description. Raises SceneError."""
    written = files.recall(("blend", main), lambda: _Written(files, main))
    written.files.read_anew()
    yaml.read(written.files, written.main, description, moment)


def _memory() -> int:
    """Three quarters of what this machine has."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4
    except (ValueError, OSError):
        return 8 << 30
