"""The example scenes shipped with Rayfarm, as files in a folder."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from service.intake.multipart import Form
from service.store.blobs import BlobStore

__all__ = ["TITLE", "Example", "examples", "files_of", "form_of"]

# Taken from the scene file: its first comment is the description, its field `name` the title.
DESCRIPTION = re.compile(r"\A# *(.+)")
TITLE = re.compile(r"^name: *[\"']?(.*?)[\"']? *$", re.MULTILINE)
# "# Frames 0-95": the frames of the example's shot; `fps`: its frame rate, if the file has one.
FRAMES = re.compile(r"^# *Frames (\S+)", re.MULTILINE)
FPS = re.compile(r"^fps: *([0-9.]+)", re.MULTILINE)


@dataclass(frozen=True)
class Example:
    """Metadata of an example scene. frames, fps: set only if it is meant to be rendered as a shot."""

    name: str
    title: str
    description: str
    frames: str | None = None
    fps: float | None = None


def examples(folder: Path) -> list[tuple[Example, Path]]:
    """Returns the examples in a folder sorted by name, each with its scene file.

    Scene files are NAME.yaml, or NAME/NAME.yaml for examples that have further files in that folder.
    """
    files = [*folder.glob("*.yaml"), *(path for path in folder.glob("*/*.yaml") if path.stem == path.parent.name)]
    return [(_read_metadata(path), path) for path in sorted(files, key=lambda path: path.stem)]


def form_of(example: Example, path: Path, blobs: BlobStore) -> Form:
    """Returns an example as the form that a client would upload."""
    form = Form({"name": example.title, "main": path.name})
    try:
        for part, file in files_of(path):
            writer = blobs.writer()
            form.files.append((part, writer))
            writer.write(file.read_bytes())
            writer.close_file()
    except BaseException:
        form.discard()
        raise
    return form


def files_of(path: Path) -> list[tuple[str, Path]]:
    """Returns all files of an example as (name in the upload, path)."""
    if path.parent.name != path.stem:
        return [(path.name, path)]
    return [(file.relative_to(path.parent).as_posix(), file) for file in sorted(path.parent.rglob("*")) if file.is_file()]


def _read_metadata(path: Path) -> Example:
    text = path.read_text(encoding="utf-8")

    def first_match(pattern: re.Pattern[str]) -> str | None:
        found = pattern.search(text)
        return found.group(1) if found else None

    frames = first_match(FRAMES)
    fps = float(first_match(FPS) or 24) if frames else None
    return Example(path.stem, first_match(TITLE) or path.stem, first_match(DESCRIPTION) or "", frames, fps)
