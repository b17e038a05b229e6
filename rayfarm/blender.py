"""Finds Blender for a worker on this machine, or installs it into a virtual environment."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from rayfarm.errors import CommandError
from renderer.blender.program import BPY, BlenderError, environment_python, find, inspect_blender

__all__ = ["Program", "Wanted", "program_for"]

PYTHON = (3, 11)  # the Python version of Blender's module
PANEL = "Blender"

Wanted = Annotated[
    bool,
    typer.Option(
        "--blender",
        help="Open .blend files: by a Blender of this machine, else by one that is fetched once.",
        rich_help_panel=PANEL,
    ),
]
Program = Annotated[
    str | None,
    typer.Option(
        metavar="PROGRAM",
        help="The same by this Blender (4.2 or later), or by a Python that has bpy. [dim]$RAYFARM_BLENDER[/dim]",
        rich_help_panel=PANEL,
    ),
]

BLENDER_UNAVAILABLE = (
    "There is no Blender on this machine, and none can be fetched: {why} Install Blender 4.2 or later so that `blender` is on "
    "the PATH, or name its program: --blender-program /path/to/blender."
)


def program_for(is_wanted: bool, named: str | None, say: Callable[[str], None]) -> str | None:
    """Returns the path of the program with which a worker opens .blend files; None if no Blender is requested.

    is_wanted: Blender is requested. named: the path or name of the program, if given. say: called with a sentence before a slow
    step. Raises CommandError if a requested Blender is not available.
    """
    if not is_wanted and named is None:
        return None
    try:
        found = inspect_blender(named) if named is not None else find()
    except BlenderError as error:
        raise CommandError(str(error)) from None
    return found.program if found is not None else str(_install_blender_module(say))


def _install_blender_module(say: Callable[[str], None]) -> Path:
    """Installs Blender's Python module into a virtual environment, since it needs another version of numpy. Returns its Python.

    Raises CommandError.
    """
    python = environment_python()
    folder = python.parents[1]
    maker = sys.executable if sys.version_info[:2] == PYTHON else shutil.which(f"python{PYTHON[0]}.{PYTHON[1]}")
    if maker is None:
        raise CommandError(BLENDER_UNAVAILABLE.format(why=f"its module needs Python {PYTHON[0]}.{PYTHON[1]}, which is not here."))
    say(f"Fetching Blender as a Python module into {folder} (once; some 370 MB) ...")
    shutil.rmtree(folder, ignore_errors=True)
    try:
        # Created in its final place, since a virtual environment contains its own path.
        subprocess.run([maker, "-m", "venv", str(folder)], check=True, capture_output=True, text=True)
        command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", BPY]
        subprocess.run(command, check=True, capture_output=True, text=True)
        return Path(inspect_blender(str(python)).program)
    except subprocess.CalledProcessError as error:
        shutil.rmtree(folder, ignore_errors=True)
        lines = (error.stderr or error.stdout or "").strip().splitlines()
        raise CommandError(BLENDER_UNAVAILABLE.format(why=f"{lines[-1][:300]}." if lines else "see above.")) from None
    except (OSError, BlenderError) as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise CommandError(BLENDER_UNAVAILABLE.format(why=f"{error}.")) from None
