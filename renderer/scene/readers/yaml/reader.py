"""A scene file as a scene: held to its schema, then part by part."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import jsonschema

from renderer.errors import SceneError, SettingsError
from renderer.scene.animation import DEFAULT_FPS, Clip, Moment
from renderer.scene.description import Camera, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.yaml.cameras import read_view
from renderer.scene.readers.yaml.geometry import Shapes
from renderer.scene.readers.yaml.keys import Keys, find_keys
from renderer.scene.readers.yaml.lights import read_environment, read_light
from renderer.scene.readers.yaml.lines import Yaml, parse
from renderer.scene.readers.yaml.materials import read_material
from renderer.scene.readers.yaml.schema import SCENE_SETTINGS, schema
from renderer.scene.readers.yaml.textures import Textures
from renderer.scene.textures import TextureShelf

__all__ = ["read"]


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description. Raises SceneError with line and field."""
    if moment.clip is not None:
        raise SceneError(f"{main}: has no clips to choose from, as glTF files have; leave the clip out")
    written, keys = files.recall(("YAML", main), lambda: _parsed(files.read(main), main))
    fps = _fps(written)
    document = written
    if keys.moves:
        document = written.holding(
            keys.at(written.data, moment.seconds(fps), lambda pattern: files.at_frame(pattern, moment.frame, main))
        )
    _validate(document)
    data: dict[str, Any] = document.data
    shelf = TextureShelf(description, files)
    description.name, description.fps = data.get("name", description.name), fps
    description.moves |= keys.moves
    if keys.tracks:
        description.clips = [Clip(description.name, keys.start, keys.end)]
    _add_defaults(data.get("settings", {}), document, description)
    for i, camera in enumerate(data.get("cameras", [])):
        _add_camera(camera, i, document, description)
    if "environment" in data:
        description.environment = read_environment(data["environment"], document, files, shelf)
    for i, light in enumerate(data.get("lights", [])):
        description.lights.append(read_light(light, i, document, ("lights", i)))
    textures = Textures(document, files, shelf)
    materials: dict[str, int] = {}
    for name, material in data.get("materials", {}).items():
        materials[name] = len(description.materials)
        description.materials.append(read_material(name, material, textures, document, ("materials", name)))
    shapes = Shapes(document, files, description, materials, replace(moment, fps=moment.fps or fps))
    for i, shape in enumerate(data["shapes"]):
        shapes.add(shape, ("shapes", i))


def _parsed(data: bytes, main: str) -> tuple[Yaml, Keys]:
    document = parse(data, main)
    return document, find_keys(document) if isinstance(document.data, dict) else Keys({}, 0.0, 0.0, [])


def _fps(document: Yaml) -> float:
    """Frames a second; what is none is left to the schema."""
    found = document.data.get("fps") if isinstance(document.data, dict) else None
    if not isinstance(found, int | float) or isinstance(found, bool):
        return DEFAULT_FPS
    try:
        return Moment(fps=float(found)).fps or DEFAULT_FPS
    except SettingsError as error:
        raise document.error(("fps",), str(error)) from None


def _add_defaults(settings: dict[str, Any], document: Yaml, description: SceneDescription) -> None:
    for name, value in settings.items():
        try:
            taken = SCENE_SETTINGS[name].check(value)
        except SettingsError as error:
            raise document.error(("settings", name), str(error)) from None
        description.defaults[name] = list(taken) if isinstance(taken, tuple) else taken


def _add_camera(source: dict[str, Any], index: int, document: Yaml, description: SceneDescription) -> None:
    name = source.get("name", f"camera {index}")
    if name in {c.name for c in description.cameras}:
        raise document.error(("cameras", index, "name"), f"another camera is called {name}; give it another name")
    description.cameras.append(Camera(name, read_view(source, document, ("cameras", index))))


@functools.cache
def _validator() -> Any:
    document = schema()
    jsonschema.Draft202012Validator.check_schema(document)
    return jsonschema.Draft202012Validator(document)


def _validate(document: Yaml) -> None:
    error = jsonschema.exceptions.best_match(_validator().iter_errors(document.data))
    if error is not None:
        path = tuple(error.absolute_path)
        message = "does not belong here" if error.validator == "not" else error.message
        if len(message) > 300:
            message = f"{message[:120]} ... {message[-120:]}"
        raise document.error(path, f"{message}. See docs/scene-format.md")
