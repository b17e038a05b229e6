"""Reads Collada files by assimp, or by trimesh where assimp rejects them."""

from __future__ import annotations

import math
import re
from collections import Counter
from copy import copy
from dataclasses import fields, replace
from typing import NamedTuple
from xml.etree import ElementTree

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers import assimp
from renderer.scene.readers.collada_holes import bridge_holes
from renderer.scene.readers.expansion_limits import collada_nodes
from renderer.scene.readers.xml import refuse_entities
from renderer.sentences import Sentence
from renderer.view import MAX_SHIFT

__all__ = ["read"]

_ASPECT = 16 / 9  # of a camera without height and aspect ratio
_FAR = 1e9
_UNREAD: dict[str, str] = {
    "spline": Sentence("collada-splines", "splines are"),
    "convex_mesh": Sentence("collada-convex-hulls", "convex hulls (convex_mesh) are"),
    "brep": Sentence("collada-breps", "boundary representations (brep) are"),
}
_FALL = 0.75  # factor of Blender's blend: makes the flux of our quadratic falloff equal to that of Blender's smoothstep
_NO_INDEX = re.compile(r"[^0-9\s]")
_UNIT = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']{1,40})[\"']")


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the file's scene at a moment to the description, in the file's unit. Raises SceneError if the file is damaged."""
    before = {field.name: copy(getattr(description, field.name)) for field in fields(description)}
    data = files.read(main)
    refuse_entities(data, main, doctype_too=False)
    own = files.get_or_make(("Collada's own", main), lambda: _extra_data(data, main))
    try:
        whole, filled = bridge_holes(data)
        metres = _metres(data)
        assimp.read(files, main, description, moment, scale=1 / (metres or 1.0), change=lambda _: whole)
        if metres is None:
            description.warnings.append(
                Sentence("collada-unit-not-length", "{file}: its unit is not a length; a metre is assumed.", file=main)
            )
        for what, count in own.unread.items():
            description.warnings.append(
                Sentence(
                    "collada-elements-left-out", "{file}: {count} {elements} left out.", file=main, count=count, elements=what
                )
            )
        if own.guessed:
            description.warnings.append(
                Sentence(
                    "collada-camera-aspect-guessed",
                    "{file}: {count} cameras have a width and no aspect ratio; 16:9 is assumed.",
                    file=main,
                    count=own.guessed,
                )
            )
        if filled:
            description.warnings.append(
                Sentence(
                    "collada-polygon-holes-filled",
                    "{file}: {count} holes of polygons could not be cut and are filled.",
                    file=main,
                    count=filled,
                )
            )
        _set_lenses(description, own.lenses)
        _set_watts(description, own.lamps)
        if own.by_blender:  # Blender's surfaces emit on both sides
            for material in description.materials[len(before["materials"]) :]:
                material.double_sided = True
    except SceneError as refused:
        for name, value in before.items():
            setattr(description, name, value)
        if moment.clip is not None:
            raise
        try:
            from renderer.scene.readers import trimesh_files  # heavy, and seldom needed

            trimesh_files.read(files, main, description)
        except SceneError:
            raise refused from None
        description.warnings.append(
            Sentence(
                "collada-read-partially",
                "{file} is read without its cameras, lights and animation, since parts of it are not Collada.",
                file=main,
            )
        )


class _ExtraData(NamedTuple):
    """The data that are read directly from the XML rather than by assimp, by the names and ids of nodes."""

    lenses: dict[str, _Lens]
    lamps: dict[str, _Lamp]
    by_blender: bool
    unread: Counter[str]  # surfaces of kinds that are not supported
    guessed: int  # cameras without an aspect ratio


def _extra_data(data: bytes, main: str) -> _ExtraData:
    """Returns the data in the XML that assimp does not provide.

    Raises SceneError if nodes contain each other, there are too many nodes, or a list of corners is malformed.
    """
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError:
        return _ExtraData({}, {}, False, Counter(), 0)
    collada_nodes(root, main)
    _refuse_odd_corners(root, main)
    by_blender = (root.findtext(".//{*}asset/{*}contributor/{*}authoring_tool") or "").startswith("Blender")
    kinds = (str(element.tag).rpartition("}")[2] for element in root.iter())
    unread: Counter[str] = Counter(_UNREAD[kind] for kind in kinds if kind in _UNREAD)
    return _ExtraData(_lenses(root), _lamps(root), by_blender, unread, _count_cameras_without_shape(root))


def _count_cameras_without_shape(root: ElementTree.Element) -> int:
    """Returns the number of cameras that have a horizontal angle or size, but neither a vertical one nor an aspect ratio."""
    optics = [
        *root.iterfind(".//{*}library_cameras/{*}camera//{*}perspective"),
        *root.iterfind(".//{*}library_cameras/{*}camera//{*}orthographic"),
    ]
    given = [{str(child.tag).rpartition("}")[2] for child in each} for each in optics]
    return sum(bool(names & {"xfov", "xmag"}) and not names & {"yfov", "ymag", "aspect_ratio"} for names in given)


def _refuse_odd_corners(root: ElementTree.Element, main: str) -> None:
    """Raises SceneError if a list of corners contains a word that is not an index; assimp would take half a minute for it."""
    for corners in root.iter():
        if str(corners.tag).endswith("}p") or corners.tag == "p":
            text = corners.text or ""
            if (odd := _NO_INDEX.search(text)) is not None:
                before = text[: odd.start()]
                word = (before[len(before.rstrip("0123456789")) :] + text[odd.start() :][:20]).split()[0][:20]
                raise SceneError(
                    Sentence(
                        "collada-index-invalid",
                        "{file}: a list of corners (<p>) contains {word}, which is not an index; export the file again",
                        file=main,
                        word=repr(word),
                    )
                )


class _Lens(NamedTuple):
    """The lens of a camera.

    fov: vertical, in degrees; height: of an orthographic view; shift_x, shift_y: in image heights.
    """

    fov: float | None
    height: float | None
    near: float
    shift_x: float
    shift_y: float


def _set_lenses(description: SceneDescription, lenses: dict[str, _Lens]) -> None:
    """Sets the cameras' lenses from the XML, since assimp reads some angles in degrees as radians and omits other properties."""
    for i, camera in enumerate(description.cameras):
        if (lens := lenses.get(camera.name)) is None:
            continue
        view = replace(camera.view, near=lens.near, shift_x=lens.shift_x, shift_y=lens.shift_y)
        if lens.height is not None:
            view = replace(view, projection="orthographic", height=lens.height)
        elif lens.fov is not None and view.projection == "perspective":
            view = replace(view, fov=lens.fov)
        description.cameras[i] = replace(camera, view=view)


def _lenses(root: ElementTree.Element) -> dict[str, _Lens]:
    """Returns the lenses of the cameras on nodes, by the nodes' names and ids."""
    by_id = {}
    for camera in root.iterfind(".//{*}library_cameras/{*}camera"):
        if (lens := _lens(camera)) is not None:
            by_id[camera.get("id")] = lens
    found = {}
    for node in root.iterfind(".//{*}node"):
        used = node.find("{*}instance_camera")
        lens = None if used is None else by_id.get((used.get("url") or "")[1:])
        for name in (node.get("id"), node.get("name")):
            if lens is not None and name:
                found[name] = lens
    return found


def _lens(camera: ElementTree.Element) -> _Lens | None:
    fov = height = None
    optics = camera.find(".//{*}perspective")
    if optics is not None:
        wide, high, aspect = (_number(optics.findtext(f"{{*}}{key}")) for key in ("xfov", "yfov", "aspect_ratio"))
        if high is None and wide is not None:
            high = math.degrees(2 * math.atan(math.tan(math.radians(wide) / 2) / (aspect or _ASPECT)))
        fov = None if high is None else min(max(high, 0.01), 179.0)
    elif (optics := camera.find(".//{*}orthographic")) is not None:
        # Half sizes of the view, as in glTF.
        wide, high, aspect = (_number(optics.findtext(f"{{*}}{key}"), below=_FAR) for key in ("xmag", "ymag", "aspect_ratio"))
        if high is None and wide is not None:
            high = wide / (aspect or _ASPECT)
        height = None if high is None else 2 * high
    if optics is None or (fov is None and height is None):
        return None
    near = _number(optics.findtext("{*}znear"), below=_FAR) or 0.0
    own = camera.find("{*}extra/{*}technique[@profile='blender']")
    shifts = [0.0, 0.0]
    if own is not None:  # in units of the image's longer side
        said = (_number(own.findtext(f"{{*}}{key}"), -MAX_SHIFT, MAX_SHIFT) or 0.0 for key in ("shiftx", "shifty"))
        shifts = [min(max(each * max(aspect or _ASPECT, 1.0), -MAX_SHIFT), MAX_SHIFT) for each in said]
    return _Lens(fov, height, near, shifts[0], shifts[1])


class _Lamp(NamedTuple):
    """Blender's own data of a light: its RGB power in watts, and a spot's inner and outer half angles in degrees."""

    watts: tuple[float, float, float]
    cone: tuple[float, float]


def _set_watts(description: SceneDescription, lamps: dict[str, _Lamp]) -> None:
    """Sets the intensities and cones of lights from Blender's data, since Collada defines no unit and no outer cone angle."""
    for light in description.lights:
        if (lamp := lamps.get(light.name)) is not None:
            scale = 1.0 if light.kind == "directional" else 1 / (4 * math.pi)
            red, green, blue = (each * scale for each in lamp.watts)
            light.intensity = (red, green, blue)
            if light.kind == "spot":
                light.inner_cone, light.outer_cone = lamp.cone


def _lamps(root: ElementTree.Element) -> dict[str, _Lamp]:
    """Returns the lights on nodes in a file written by Blender, by the nodes' names and ids."""
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


def _metres(data: bytes) -> float | None:
    """Returns the file's unit in metres; 1 if not given, None if invalid."""
    said = _UNIT.search(data[:100_000])
    try:
        found = float(said.group(1)) if said else 1.0
    except ValueError:
        return None
    return found if math.isfinite(found) and 1e-9 < found < 1e9 else None
