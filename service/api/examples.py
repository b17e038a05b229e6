"""/api/examples: the scenes that Rayfarm ships, so that a newcomer has a picture in two clicks."""

from __future__ import annotations

import re
from pathlib import Path

from fastapi import APIRouter, Response
from pydantic import BaseModel

from service.api.problem import Problem
from service.api.scenes import record
from service.api.schemas import SceneOut
from service.farm import Farm, FarmDependency
from service.intake.multipart import Form
from service.intake.uploads import full_disk, keep

__all__ = ["router"]

router = APIRouter(prefix="/api/examples", tags=["examples"])

# A scene file's own words: its first comment says what is to be seen, its field `name` what it is called.
DESCRIPTION = re.compile(r"\A# *(.+)")
TITLE = re.compile(r"^name: *[\"']?(.*?)[\"']? *$", re.MULTILINE)


class ExampleOut(BaseModel):
    """A scene that can be opened without an upload."""

    name: str
    title: str
    description: str


@router.get("", response_model=list[ExampleOut])
def list_examples(farm: FarmDependency) -> list[ExampleOut]:
    """The examples, by name."""
    return [_described(path) for path in _files(farm)]


@router.post("/{name}", status_code=201, response_model=SceneOut)
def open_example(name: str, farm: FarmDependency, response: Response) -> SceneOut:
    """Make a scene of an example, as if its files had been uploaded. Opened again, it is the same scene."""
    path = next((path for path in _files(farm) if path.stem == name), None)
    if path is None:
        raise Problem(404, f"There is no example {name[:60]!r}. GET /api/examples lists those that are there.")
    with full_disk():
        form = _form(path, farm)
    scene = keep(form, farm.blobs, farm.garbage, farm.settings, lambda size: None, lambda stored: record(stored, farm))
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return scene


def _form(path: Path, farm: Farm) -> Form:
    """An example as the form by which it would be uploaded."""
    form = Form({"name": _described(path).title, "main": path.name})
    try:
        for part, file in _parts(path):
            writer = farm.blobs.writer()
            form.files.append((part, writer))
            writer.write(file.read_bytes())
    except BaseException:
        form.discard()
        raise
    return form


def _files(farm: Farm) -> list[Path]:
    """The scene files: NAME.yaml, and NAME/NAME.yaml of those that have other files beside them."""
    folder = farm.settings.examples
    return sorted(
        [*folder.glob("*.yaml"), *(p for p in folder.glob("*/*.yaml") if p.stem == p.parent.name)], key=lambda p: p.stem
    )


def _parts(path: Path) -> list[tuple[str, Path]]:
    """All files of an example, by their names in an upload."""
    if path.parent.name != path.stem:
        return [(path.name, path)]
    return [(file.relative_to(path.parent).as_posix(), file) for file in sorted(path.parent.rglob("*")) if file.is_file()]


def _described(path: Path) -> ExampleOut:
    text = path.read_text(encoding="utf-8")
    title, description = TITLE.search(text), DESCRIPTION.search(text)
    return ExampleOut(
        name=path.stem,
        title=title.group(1) if title else path.stem,
        description=description.group(1) if description else "",
    )
