"""Decodes names of a description that are not UTF-8."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import PurePosixPath

from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.text_encoding import is_readable, likely_encoding, readable, title
from renderer.sentences import Sentence

__all__ = ["make_readable"]


def make_readable(description: SceneDescription, files: SceneFiles, main: str) -> None:
    """Decodes bytes that are not UTF-8 in a description's names and warnings, and adds a warning with their count.

    Uses the encoding by which such names matched existing files, else the likely one, else Latin-1.
    """
    changed = _unreadable(description)
    common = files.encodings.most_common(1)
    encoding = common[0][0] if common else likely_encoding(changed)

    def text(name: str) -> str:
        return readable(name, encoding)

    for material in description.materials:
        material.name = text(material.name)
    for mesh in description.meshes:
        mesh.name = text(mesh.name)
    for instance in description.instances:
        instance.name = text(instance.name)
    for image in description.images:
        image.name = text(image.name)
    for light in description.lights:
        light.name = text(light.name)
    description.cameras[:] = [
        camera if is_readable(camera.name) else replace(camera, name=text(camera.name)) for camera in description.cameras
    ]
    description.warnings[:] = [
        w
        if is_readable(w)
        else w.mapped(partial(readable, encoding=encoding))
        if isinstance(w, Sentence)
        else readable(w, encoding)
        for w in description.warnings
    ]
    found = common[0][1] if common else 0
    if changed or found:
        count, name = max(len(changed), found), PurePosixPath(main).name
        description.warnings.append(
            Sentence(
                "names-encoding-guessed",
                "{name}: {count} names are not in UTF-8; they are read as {encoding}, which finds {found} of the files.",
                name=name,
                count=count,
                encoding=title(common[0][0]),
                found=found,
            )
            if common
            else Sentence(
                "names-encoding-likely",
                "{name}: {count} names are not in UTF-8; they are read as {encoding}, which is a guess.",
                name=name,
                count=count,
                encoding=title(encoding),
            )
            if encoding
            else Sentence(
                "names-read-as-latin",
                "{name}: {count} names are not in UTF-8; they are read as Latin-1, which is a guess.",
                name=name,
                count=count,
            )
        )


def _unreadable(description: SceneDescription) -> set[str]:
    """Returns the names that are not UTF-8, also those in warnings."""
    parts = (description.materials, description.meshes, description.instances, description.images, description.lights)
    names: list[str] = [each.name for part in (*parts, description.cameras) for each in part]
    for warning in description.warnings:
        names += _texts(warning) if isinstance(warning, Sentence) else []
    return {name for name in names if not is_readable(name)}


def _texts(value: object) -> Iterator[str]:
    """Yields the texts among a sentence's parameters."""
    if isinstance(value, Sentence):
        value = list(value.params.values())
    if isinstance(value, list):
        for each in value:
            yield from _texts(each)
    elif isinstance(value, str):
        yield value
