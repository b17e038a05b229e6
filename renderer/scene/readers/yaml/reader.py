"""Reads a scene file: checks it against the schema, then reads its parts."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import jsonschema

from renderer.errors import SceneError, SettingsError
from renderer.scene.animation import DEFAULT_FPS, Clip, Moment
from renderer.scene.description import Camera, LightLink, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.given_spectra import black_body_light
from renderer.scene.readers.yaml.camera_moves import animated_view, interpolated_view
from renderer.scene.readers.yaml.cameras import read_view
from renderer.scene.readers.yaml.geometry import Shapes
from renderer.scene.readers.yaml.keys import AnimatedPaths, Keys, find_keys
from renderer.scene.readers.yaml.lights import Lights, read_environment, read_medium
from renderer.scene.readers.yaml.lines import Yaml, parse
from renderer.scene.readers.yaml.materials import read_material
from renderer.scene.readers.yaml.messages import schema_fault
from renderer.scene.readers.yaml.schema import SCENE_SETTINGS, schema
from renderer.scene.readers.yaml.textures import Textures
from renderer.scene.readers.yaml.volumes import read_scene_volume
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, from_text
from renderer.settings import View
from renderer.variation import Variation

__all__ = ["read"]


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description. Raises SceneError, with line and field, if the file is invalid."""
    if moment.clip is not None:
        raise SceneError(
            Sentence(
                "scene-description-without-clips",
                "{file} has no clips, as glTF files do; leave the clip out",
                file=main,
            )
        )
    written, keys = files.get_or_make(("YAML", main), lambda: _parsed(files.read(main), main))
    fps = _fps(written)
    document = written
    if keys.is_animated:
        document = written.with_data(
            keys.data_at(written.data, moment.seconds(fps), lambda pattern: files.at_frame(pattern, moment.frame, main))
        )
    moving = keys.animated_paths()
    _check(files, main, document, moving)
    data: dict[str, Any] = document.data
    shelf = TextureShelf(description, files)
    if "color_config" in data:
        shelf.colors.choose(data["color_config"], main)
    if "vary" in data:
        _check_variation(document)
        description.vary = data["vary"]
    description.name, description.fps = data.get("name", description.name), fps
    description.warnings += map(from_text, data.get("notes", []))
    _add_defaults(data.get("settings", {}), document, description)
    ends = _add_cameras(data.get("cameras", []), moment.seconds(fps), document, description)
    description.moves = description.moves or keys.is_animated or len(ends) > 0
    if keys.tracks or ends:
        description.clips = [Clip(description.name, min(keys.start, 0.0) if ends else keys.start, max(keys.end, *ends, 0.0))]
    if "environment" in data:
        description.environment = read_environment(data["environment"], document, files, shelf)
        description.environment_group = data["environment"].get("light_group", "")
    description.light_links = {
        name: LightLink(None if "include" not in link else tuple(link["include"]), tuple(link.get("exclude", ())))
        for name, link in data.get("light_links", {}).items()
    }
    for name, volume in data.get("volumes", {}).items():
        description.volumes[name] = read_scene_volume(volume, document, files, ("volumes", name))
    description.displaced_triangles = int(data.get("displaced_triangles", description.displaced_triangles))
    if "medium" in data:
        description.medium = read_medium(data["medium"])
    lights = Lights(document, files, shelf, description)
    for i, light in enumerate(data.get("lights", [])):
        found = lights.read(light, i, ("lights", i))
        if found.temperature > 0:
            found.intensity = black_body_light(found.intensity, found.temperature, description.spectra)
        description.lights.append(found)
    textures = Textures(document, files, shelf)
    materials: dict[str, int] = {}
    for name, material in data.get("materials", {}).items():
        materials[name] = len(description.materials)
        made = read_material(name, material, textures, document, ("materials", name))
        if made.emission_temperature > 0:
            made.emission = black_body_light(made.emission, made.emission_temperature, description.spectra)
        description.materials.append(made)
    shapes = Shapes(document, files, description, materials, replace(moment, fps=moment.fps or fps), moving)
    for i, shape in enumerate(data["shapes"]):
        shapes.add(shape, ("shapes", i))
    if placed := [clip for clip in (*description.clips, *shapes.clips) if clip.end > clip.start]:
        start, end = min(clip.start for clip in placed), max(clip.end for clip in placed)
        description.clips = [Clip(description.name, start, end)]


def _parsed(data: bytes, main: str) -> tuple[Yaml, Keys]:
    document = parse(data, main)
    return document, find_keys(document) if isinstance(document.data, dict) else Keys({}, 0.0, 0.0, [])


def _fps(document: Yaml) -> float:
    """Returns the file's frames per second, or the default; the later schema check raises errors for values of a wrong type.

    Raises SceneError if the number is out of range.
    """
    found = document.data.get("fps") if isinstance(document.data, dict) else None
    if not isinstance(found, int | float) or isinstance(found, bool):
        return DEFAULT_FPS
    try:
        return Moment(fps=float(found)).fps or DEFAULT_FPS
    except SettingsError as error:
        raise document.error(("fps",), str(error)) from None


def _check_variation(document: Yaml) -> None:
    """Raises SceneError if the file's `vary`, by which data sets vary the scene, is invalid."""
    try:
        Variation.parse(document.data["vary"])
    except SettingsError as error:
        raise document.error(("vary",), Sentence("scene-vary-wrong", "is invalid: {error}", error=error)) from None


def _add_defaults(settings: dict[str, Any], document: Yaml, description: SceneDescription) -> None:
    for name, value in settings.items():
        try:
            taken = SCENE_SETTINGS[name].check(value)
        except SettingsError as error:
            raise document.error(("settings", name), str(error)) from None
        description.defaults[name] = list(taken) if isinstance(taken, tuple) else taken


def _add_cameras(sources: list[dict[str, Any]], time: float, document: Yaml, description: SceneDescription) -> list[float]:
    """Adds the file's cameras, as they are at a time in seconds; returns the durations, in seconds, of the cameras' moves."""
    views: dict[str, View | None] = {}
    for i, source in enumerate(sources):
        name = source.get("name", f"camera {i}")
        if name in views:
            raise document.error(
                ("cameras", i, "name"),
                Sentence("camera-name-duplicate", "another camera is called {name}; rename one", name=name),
            )
        views[name] = None if "through" in source else animated_view(read_view(source, document, ("cameras", i)), source, time)
    for i, (name, source) in enumerate(zip(views, sources, strict=True)):
        if (view := views[name]) is None:
            view = interpolated_view(
                _views_by_name(source["through"], views, document, i), source["seconds"], time, document, ("cameras", i)
            )
        description.cameras.append(Camera(name, view))
    return [float(source[key]) for source in sources for key in ("turntable", "seconds") if key in source]


def _views_by_name(names: list[str], views: dict[str, View | None], document: Yaml, camera: int) -> list[View]:
    found = []
    for i, name in enumerate(names):
        view = views.get(name)
        if view is None:
            known = [other for other, its in list(views.items())[:10] if its is not None]
            raise document.error(
                ("cameras", camera, "through", i),
                Sentence("camera-name-unknown", "there is no camera {name}; the cameras are {known}", name=name, known=known)
                if known
                else Sentence("camera-name-without-cameras", "there is no camera {name} with a view of its own", name=name),
            )
        found.append(view)
    return found


@functools.cache
def _validator() -> Any:
    return jsonschema.Draft202012Validator(schema())  # not checked here, which takes 0.25 s; a test does


def _check(files: SceneFiles, main: str, document: Yaml, moving: AnimatedPaths) -> None:
    """Checks a document against the schema, completely at the first moment read and only its animated parts at further ones.

    Raises SceneError for the first fault.
    """

    def validate() -> Yaml:
        _validate(document, document.data, {})
        return document

    if files.get_or_make(("YAML, held to its schema", main), validate) is not document:
        _validate(document, *_part_of(document.data, moving))


def _part_of(data: dict[str, Any], moving: AnimatedPaths) -> tuple[dict[str, Any], dict[str, list[int]]]:
    """Returns the animated parts of a document's data, and for each list there the original indices of its remaining items.

    Each list and object retains at least one item, since the schema may require one.
    """
    part: dict[str, Any] = {}
    places: dict[str, list[int]] = {}
    for name, value in data.items():
        steps = moving.animated_fields((name,))
        if not value or moving.is_animated((name,)):
            part[name] = value
        elif isinstance(value, list):
            places[name] = sorted(step for step in steps if isinstance(step, int)) or [0]
            part[name] = [value[place] for place in places[name]]
        elif name == "materials":
            part[name] = {each: value[each] for each in steps or list(value)[:1]}
        else:
            part[name] = value
    return part, places


def _validate(document: Yaml, data: Any, places: dict[str, list[int]]) -> None:
    error = jsonschema.exceptions.best_match(_validator().iter_errors(data))
    if error is not None:
        path = tuple(error.absolute_path)
        if len(path) > 1 and path[0] in places:
            path = (path[0], places[path[0]][path[1]], *path[2:])
        fault = schema_fault(error)
        raise document.error(path, Sentence("scene-description-invalid", "{fault}. See docs/scene-format.md", fault=fault))
