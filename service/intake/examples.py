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


@dataclass(frozen=True)
class Example:
    """What is said of an example."""

    name: str
    title: str
    description: str


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
    title, description = TITLE.search(text), DESCRIPTION.search(text)
    return Example(path.stem, title.group(1) if title else path.stem, description.group(1) if description else "")
