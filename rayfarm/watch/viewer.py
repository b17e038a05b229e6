"""Opens a picture file in another program."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from rayfarm.errors import CommandError

__all__ = ["command_of", "open_in"]

BLENDER = "blender"
# Blender has no argument for a picture: the largest part of its window becomes an image editor that shows it.
IN_BLENDER = """\
import bpy
image = bpy.data.images.load({path!r})
areas = bpy.context.window_manager.windows[0].screen.areas
area = max(areas, key=lambda each: each.width * each.height)
area.type = "IMAGE_EDITOR"
area.spaces.active.image = image
"""


def command_of(viewer: str, path: Path) -> list[str]:
    """Returns the viewer's command line. viewer: empty: the system's default program. Raises CommandError."""
    if viewer:
        try:
            command = shlex.split(viewer)
        except ValueError as error:
            raise CommandError(f"--viewer is {viewer!r}, whose quotes do not end ({error})") from None
        if not command or shutil.which(command[0]) is None:
            raise CommandError(f"There is no program {viewer!r}. --viewer takes one with its arguments; alone, the system's own.")
        if Path(command[0]).name.startswith(BLENDER):
            return [*command, "--python-expr", IN_BLENDER.format(path=str(path))]
        return [*command, str(path)]
    opener = "open" if sys.platform == "darwin" else "xdg-open"
    if shutil.which(opener) is None:
        raise CommandError(f"This machine has no {opener} to open pictures by. Name a program: --viewer tev")
    return [opener, str(path)]


def open_in(viewer: str, path: Path) -> None:
    """Opens a file in a viewer without waiting. Raises CommandError if the program is missing or does not start."""
    command = command_of(viewer, path)
    try:
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=os.environ.copy(),
        )
    except OSError as error:
        raise CommandError(f"{command[0]} cannot be started ({error.strerror or error}). The picture: {path}") from None
