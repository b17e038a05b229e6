"""Reads .blend and Alembic files: Blender, in a separate process, converts them to Rayfarm's scene format."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from pathlib import Path

from renderer.blender.opening import open_in_blender
from renderer.confine.reader import call_parent, is_reader
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers import yaml

__all__ = ["read"]


class _ConvertedFile:
    """A file's scene as exported by Blender to a temporary folder.

    The folder is deleted when this object is garbage-collected.
    """

    def __init__(self, files: SceneFiles, name: str) -> None:
        """Converts a file of the scene by running Blender. Raises SceneError if Blender fails."""
        path = files.path(name)
        root = path.parents[len(Path(name).parts) - 1]
        folder = Path(tempfile.mkdtemp(prefix="rayfarm-blend-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        if is_reader():  # a reader process may not start programs
            self.main = str(call_parent("blender", name=name, out=str(folder)))
        else:
            self.main = open_in_blender(root, name, folder)
        self.files = SceneFiles(folder)


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description. Raises SceneError if Blender cannot convert the file."""
    written = files.get_or_make(("blend", main), lambda: _ConvertedFile(files, main))
    written.files.read_anew()
    yaml.read(written.files, written.main, description, moment)
