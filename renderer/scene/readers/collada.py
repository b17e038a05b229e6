"""Collada: all of it by assimp; what that refuses, as far as trimesh reads it."""

from __future__ import annotations

import math
import re
from copy import copy
from dataclasses import fields, replace
from typing import NamedTuple
from xml.etree import ElementTree

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers import assimp
from renderer.scene.readers.spread import collada_nodes
from renderer.scene.readers.xml import refuse_entities

__all__ = ["read"]

_ASPECT = 16 / 9  # of a camera that says neither its height nor its shape
_FALL = 0.75  # of Blender's blend: there its smooth step and our square send out as much
_UNIT = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']{1,40})[\"']")


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description, in the file's own unit. Raises SceneError."""
    before = {field.name: copy(getattr(description, field.name)) for field in fields(description)}
    data = files.read(main)
    refuse_entities(data, main, doctype_too=False)
    own = files.recall(("Collada's own", main), lambda: _own(data, main))
    try:
        assimp.read(files, main, description, moment, scale=1 / _metres(data))
        _set_lenses(description, own.lenses)
        _set_watts(description, own.lamps)
    except SceneError as refused:
        for name, value in before.items():
            setattr(description, name, value)
        if moment.clip is not None:
            raise
        try:
            from renderer.scene.readers import other  # heavy, and seldom needed

            other.read(files, main, description)
        except SceneError:
            raise refused from None
        description.warnings.append(f"{main}: is read without its cameras, lights and animation, as not all of it is Collada.")


class _Own(NamedTuple):
    """What is read of a file beside assimp, by the nodes' names and ids."""

    lenses: dict[str, float]
    lamps: dict[str, _Lamp]


def _own(data: bytes, main: str) -> _Own:
    """Raises SceneError where the file's nodes contain each other, or are too many."""
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError:
        return _Own({}, {})
    collada_nodes(root, main)
    return _Own(_lenses(root), _lamps(root))


def _set_lenses(description: SceneDescription, lenses: dict[str, float]) -> None:
    """Gives cameras their vertical fields of view: assimp takes the degrees of some for radians."""
    for i, camera in enumerate(description.cameras):
        fov = lenses.get(camera.name)
        if fov is not None and camera.view.projection == "perspective":
            description.cameras[i] = replace(camera, view=replace(camera.view, fov=fov))


def _lenses(root: ElementTree.Element) -> dict[str, float]:
    """The vertical fields of view, in degrees, of the cameras on nodes, by the nodes' names and ids."""
    by_id = {}
    for camera in root.iterfind(".//{*}library_cameras/{*}camera"):
        said = {key: _number(camera.findtext(f".//{{*}}perspective/{{*}}{key}")) for key in ("xfov", "yfov", "aspect_ratio")}
        wide, high, aspect = said["xfov"], said["yfov"], said["aspect_ratio"] or _ASPECT
        if high is None and wide is not None:
            high = math.degrees(2 * math.atan(math.tan(math.radians(wide) / 2) / aspect))
        if high is not None:
            by_id[camera.get("id")] = min(max(high, 0.01), 179.0)
    found = {}
    for node in root.iterfind(".//{*}node"):
        used = node.find("{*}instance_camera")
        fov = None if used is None else by_id.get((used.get("url") or "")[1:])
        for name in (node.get("id"), node.get("name")):
            if fov is not None and name:
                found[name] = fov
    return found


class _Lamp(NamedTuple):
    """What Blender says of a light, in watts; and of a spot the half angles of its cone, in degrees."""

    watts: tuple[float, float, float]
    cone: tuple[float, float]


def _set_watts(description: SceneDescription, lamps: dict[str, _Lamp]) -> None:
    """Gives lights what Blender says of them: Collada itself has no unit, and its cones end nowhere."""
    for light in description.lights:
        if (lamp := lamps.get(light.name)) is not None:
            scale = 1.0 if light.kind == "directional" else 1 / (4 * math.pi)
            red, green, blue = (each * scale for each in lamp.watts)
            light.intensity = (red, green, blue)
            if light.kind == "spot":
                light.inner_cone, light.outer_cone = lamp.cone


def _lamps(root: ElementTree.Element) -> dict[str, _Lamp]:
    """Of a file that Blender wrote, the lights on nodes, by the nodes' names and ids."""
    by_id = {}
    for light in root.iterfind(".//{*}library_lights/{*}light"):
        own = light.find("{*}extra/{*}technique[@profile='blender']")
        if own is None:
            continue
        names = ("red", "green", "blue", "energy", "spotsize", "spotblend")
        said = [each for name in names if (each := _number(own.findtext(f"{{*}}{name}"), -1e-9, 1e9)) is not None]
        if len(said) == len(names):
            red, green, blue, watts, across, blend = said
            outer = min(across / 2, 89.9)
            edge = math.cos(math.radians(outer))
            inner = math.degrees(math.acos(min(edge + (1 - edge) * min(blend, 1.0) * _FALL, 1.0)))
            by_id[light.get("id")] = _Lamp((red * watts, green * watts, blue * watts), (min(inner, outer), outer))
    found = {}
    for node in root.iterfind(".//{*}node"):
        used = node.find("{*}instance_light")
        lamp = None if used is None else by_id.get((used.get("url") or "")[1:])
        for name in (node.get("id"), node.get("name")):
            if lamp is not None and name:
                found[name] = lamp
    return found


def _number(words: str | None, above: float = 0.0, below: float = 180.0) -> float | None:
    try:
        value = float(words) if words else math.nan
    except ValueError:
        return None
    return value if above < value < below else None


def _metres(data: bytes) -> float:
    """How long the file's unit is."""
    said = _UNIT.search(data[:100_000])
    try:
        found = float(said.group(1)) if said else 1.0
    except ValueError:
        return 1.0
    return found if math.isfinite(found) and 1e-9 < found < 1e9 else 1.0
