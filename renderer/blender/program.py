"""Locates Blender: a program, or a Python with Blender as a module."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from renderer.cache_folders import private_folder
from renderer.library_messages import library_message
from renderer.sentences import Sentence

__all__ = ["BPY", "NAMED", "Blender", "BlenderError", "environment_python", "find", "inspect_blender"]

NAMED = "RAYFARM_BLENDER"
BPY = "bpy>=4.5,<4.6"  # a release with long-term support
MIN_VERSION = (4, 2)
PATIENCE_S = 120.0
_MODULE = "import importlib.metadata as m, sys; print(m.version('bpy')); print(sys.prefix); print(sys.base_prefix)"


class BlenderError(Exception):
    """Raised if no usable Blender was found; the message names a remedy."""


@dataclass(frozen=True)
class Blender:
    """A program that runs our scripts in Blender: Blender itself, or a Python with Blender as a module."""

    program: str
    version: str
    is_module: bool
    reads: tuple[str, ...]  # the folders that it needs

    def command(self, script: Path, *arguments: str) -> list[str]:
        """Returns the command line that runs a script in Blender with these arguments."""
        if self.is_module:
            return [self.program, "-I", str(script), *arguments]
        options = ["--background", "--factory-startup", "--disable-autoexec", "--python-exit-code", "3"]
        return [self.program, *options, "--python", str(script), "--", *arguments]


def environment_python() -> Path:
    """Returns the path of the Python in the virtual environment that `rayfarm worker --blender` creates for Blender."""
    return private_folder("blender") / "bin" / "python"


def find() -> Blender | None:
    """Returns the Blender to use; None if there is none.

    Looks in this order: the path in the variable RAYFARM_BLENDER; the Python virtual environment that `rayfarm worker --blender`
    creates; a program `blender` on the PATH. Raises BlenderError if RAYFARM_BLENDER names an unusable program.
    """
    if named := os.environ.get(NAMED):
        return inspect_blender(named)
    for path in (str(environment_python()), shutil.which("blender")):
        if path is not None and Path(path).exists():
            try:
                return inspect_blender(path)
            except BlenderError:
                continue
    return None


@functools.cache
def inspect_blender(path: str) -> Blender:
    """Returns the Blender at a path, which is a Blender program or a Python with Blender as a module.

    Raises BlenderError if it is unusable.
    """
    place = Path(path).expanduser()
    program = str(place) if place.exists() else shutil.which(path)
    if program is None:
        raise BlenderError(
            Sentence(
                "blender-path-not-found",
                "There is no Blender at {path}. Give the path of its program, or of a Python that has bpy.",
                path=path,
            )
        )
    is_module = Path(program).name.startswith("python")
    command = [program, "-I", "-c", _MODULE] if is_module else [program, "--background", "--factory-startup", "--version"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BlenderError(
            Sentence(
                "blender-not-startable", "{program} does not start ({error}).", program=program, error=library_message(error)
            )
        ) from None
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        raise BlenderError(
            Sentence(
                "blender-without-bpy",
                "{program} has no module bpy. Give the path of Blender's program, or of a Python that has bpy.",
                program=program,
            )
            if is_module
            else Sentence(
                "blender-program-invalid",
                "{program} is not Blender. Give the path of Blender's program, or of a Python that has bpy.",
                program=program,
            )
        )
    if is_module:
        version, folders = lines[0], tuple(lines[1:])
    else:
        said = next((line for line in lines if line.startswith("Blender ")), "")
        version, folders = said.removeprefix("Blender ").split(" ")[0], (str(Path(program).resolve().parent),)
    if _numbers(version) < MIN_VERSION:
        raise BlenderError(
            Sentence(
                "blender-too-old",
                "{program} is Blender {version}; .blend files need {least_major}.{least_minor} or later.",
                program=program,
                version=version or "?",
                least_major=MIN_VERSION[0],
                least_minor=MIN_VERSION[1],
            )
        )
    return Blender(program, version, is_module, folders)


def _numbers(version: str) -> tuple[int, ...]:
    parts = version.split(".")[:2]
    return tuple(int(part) for part in parts) if all(part.isdigit() for part in parts) and len(parts) == 2 else (0, 0)
