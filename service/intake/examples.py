"""The scenes that Rayfarm ships, as files beside it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from service.intake.multipart import Form
from service.store.blobs import BlobStore

__all__ = ["Example", "examples", "form_of"]

# A scene file's own words: its first comment says what is to be seen, its field `name` what it is called.
DESCRIPTION = re.compile(r"\A# *(.+)")
TITLE = re.compile(r"^name: *[\"']?(.*?)[\"']? *$", re.MULTILINE)
# "# Frames 0-95": what of it is a shot; and how many of them a second has, where the file says so.
FRAMES = re.compile(r"^# *Frames (\S+)", re.MULTILINE)
FPS = re.compile(r"^fps: *([0-9.]+)", re.MULTILINE)


@dataclass(frozen=True)
class Example:
    """What is said of an example. frames, fps: of one that is made as a shot."""

    name: str
    title: str
    description: str
    frames: str | None = None
    fps: float | None = None


def examples(folder: Path) -> list[tuple[Example, Path]]:
    """The examples by name, and their scene files: NAME.yaml, and NAME/NAME.yaml of those that have other files beside them."""
    files = [*folder.glob("*.yaml"), *(path for path in folder.glob("*/*.yaml") if path.stem == path.parent.name)]
    return [(_described(path), path) for path in sorted(files, key=lambda path: path.stem)]


def form_of(example: Example, path: Path, blobs: BlobStore) -> Form:
    """An example as the form by which it would be uploaded."""
    form = Form({"name": example.title, "main": path.name})
    try:
        for part, file in _parts(path):
            writer = blobs.writer()
            form.files.append((part, writer))
            writer.write(file.read_bytes())
            writer.end()
    except BaseException:
        form.discard()
        raise
    return form


def _parts(path: Path) -> list[tuple[str, Path]]:
    """All files of an example, by their names in an upload."""
    if path.parent.name != path.stem:
        return [(path.name, path)]
    return [(file.relative_to(path.parent).as_posix(), file) for file in sorted(path.parent.rglob("*")) if file.is_file()]


def _described(path: Path) -> Example:
    text = path.read_text(encoding="utf-8")

    def told(pattern: re.Pattern[str]) -> str | None:
        found = pattern.search(text)
        return found.group(1) if found else None

    frames = told(FRAMES)
    fps = float(told(FPS) or 24) if frames else None
    return Example(path.stem, told(TITLE) or path.stem, told(DESCRIPTION) or "", frames, fps)
