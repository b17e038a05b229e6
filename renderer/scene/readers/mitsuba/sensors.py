"""Converts cameras, and the render settings in film, sampler and integrator."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from renderer.errors import SceneError, SettingsError
from renderer.scene.description import Camera, SceneDescription, Vec3
from renderer.scene.readers.crop_window import Window, cropped
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.sentences import Sentence
from renderer.settings import MAX_DEPTH, View

__all__ = ["add_integrator", "add_sensor", "note_far_clipping", "vertical_fov"]

_FILM = (768, 576)
_FILTERS = {"box": "box", "tent": "tent"}
_SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol")
_WIDTHS = {"box": ("radius", 0.5), "tent": ("radius", 1.0), "gaussian": ("stddev", 0.5)}
_UNBOUNDED = 64  # path segments for unlimited depth; Russian roulette terminates nearly all paths earlier
_DIAGONAL_MM = math.hypot(36, 24)


def add_sensor(source: Element, document: Document, description: SceneDescription) -> None:
    """Adds a camera. The film and sampler of the first camera determine the scene's settings."""
    width, height, window = _film(source, document, description, is_first=not description.cameras)
    world = source.matrix()
    eye, forward, up = world[:3, 3], world[:3, 2], world[:3, 1]
    if np.linalg.det(world[:3, :3]) < 0:
        document.ignore(
            Sentence(
                "mitsuba-mirrored-camera",
                "{what}: its transform mirrors the picture; it is shown unmirrored",
                what=source.description,
            )
        )
    near = max(source.number("near_clip", 1e-2), 0.0)
    near = 0.0 if near <= 1e-2 else near
    fields: dict[str, Any] = {"eye": _vec(eye), "target": _vec(eye + forward), "up": _vec(up)}
    if source.type in ("perspective", "thinlens"):
        fov = vertical_fov(source, width, height)
        focus, aperture = None, 0.0
        if source.type == "thinlens":
            aperture = max(source.number("aperture_radius", 0.0), 0.0)
            focus = max(source.number("focus_distance", 1.0), 1e-6)
        more: dict[str, Any] = {"fov": fov, "aperture": aperture, "focus": focus, "near": near}
        # As fractions of the film's width and height, downwards.
        more["shift_x"] = source.number("principal_point_offset_x", 0.0) * width / height
        more["shift_y"] = -source.number("principal_point_offset_y", 0.0)
    elif source.type == "orthographic":
        across = float(np.linalg.norm(world[:3, 0]))
        more = {"projection": "orthographic", "height": 2 * across * height / width, "near": near}
    else:
        document.ignore(
            Sentence(
                "mitsuba-sensor-type-unsupported", "{what} is not supported as a camera: it is left out", what=source.description
            )
        )
        return
    try:
        view = View(**cropped(fields | more, (width, height), window))
        description.cameras.append(Camera(source.id or f"sensor {len(description.cameras)}", view))
    except SettingsError as error:
        document.ignore(
            Sentence("camera-sees-nothing", "{what} has an invalid view: {error}", what=source.description, error=error)
        )


def vertical_fov(source: Element, width: int, height: int) -> float:
    """Returns the vertical field of view in degrees; by default that of a 50 mm lens on 35 mm film.

    width, height: of the image in pixels. Raises SceneError if the sensor's fov_axis is unknown.
    """
    ratio = width / height
    fov = source.get("fov")
    axis = str(source.get("fov_axis", "x"))
    if fov is not None:
        half = math.tan(min(max(math.radians(source.number("fov", 50.0)), 1e-6), math.radians(179.9)) / 2)
    else:
        half, axis = _DIAGONAL_MM / 2 / _millimetres(source), "diagonal"
    if axis not in ("x", "y", "diagonal", "larger", "smaller"):
        raise SceneError(
            Sentence(
                "mitsuba-fov-axis-unknown",
                "{file}: {what}: its fov_axis is {axis}; known are x, y, diagonal, smaller and larger",
                file=source.file,
                what=source.description,
                axis=repr(axis[:40]),
            )
        )
    if axis == "larger":
        axis = "x" if ratio > 1 else "y"
    elif axis == "smaller":
        axis = "y" if ratio > 1 else "x"
    if axis == "x":
        half /= ratio
    elif axis == "diagonal":
        half /= math.hypot(ratio, 1)
    return min(max(math.degrees(2 * math.atan(half)), 0.01), 179.0)


def _millimetres(source: Element) -> float:
    """Returns a sensor's focal length in millimetres. Raises SceneError if it is not a positive length."""
    written = str(source.get("focal_length", "50mm"))
    try:
        found = float(written.strip().removesuffix("mm"))
    except ValueError:
        found = math.nan
    if not (0 < found < math.inf):
        raise SceneError(
            Sentence(
                "mitsuba-focal-length-invalid",
                "{file}: {what}: its focal_length is {value}; write it in millimetres, such as 50mm",
                file=source.file,
                what=source.description,
                value=repr(written[:40]),
            )
        )
    return found


def _film(source: Element, document: Document, description: SceneDescription, is_first: bool) -> tuple[int, int, Window]:
    """Returns the film's width, height and crop window.

    is_first: whether to set the scene's settings from the film and sampler.
    """
    film = next(iter(source.children_of("film")), None)
    sampler = next(iter(source.children_of("sampler")), None)
    named = next(iter(film.children_of("rfilter")), None) if film is not None else None
    for part in (sampler, named):
        if part is not None:
            part.mark_used()
    width, height = _FILM
    if film is not None:
        width, height = (max(int(film.number(key, size)), 1) for key, size in zip(("width", "height"), _FILM, strict=True))
        window = _window(film, width, height)
        if film.type != "hdrfilm":
            document.ignore(
                Sentence(
                    "film-type-replaced",
                    "{what}: is replaced by a film of linear RGB",
                    what=film.description,
                )
            )
        if (pixels := str(film.get("pixel_format", "rgb"))) not in ("rgb", "rgba"):
            document.ignore(
                Sentence(
                    "mitsuba-pixel-format-ignored",
                    "{what}: its pixel_format {format} is ignored: RGB is rendered",
                    what=film.description,
                    format=pixels[:40],
                )
            )
    else:
        window = Window(0, 0, width, height)
    if is_first:
        description.defaults["width"], description.defaults["height"] = min(window.width, 16384), min(window.height, 16384)
        if sampler is not None:
            description.defaults["spp"] = max(int(sampler.number("sample_count", 4)), 1)
            if sampler.type not in _SAMPLERS:
                document.ignore(
                    Sentence(
                        "sampler-unknown",
                        "{what} is unknown: only its sample count is used",
                        what=sampler.description,
                    )
                )
        if named is not None and named.type in _WIDTHS:
            parameter, usual = _WIDTHS[named.type]
            if (width_of := named.number(parameter, usual)) != usual:
                document.ignore(
                    Sentence(
                        "mitsuba-filter-width-ignored",
                        "{what}: its {parameter} of {filter} is ignored; {used} is used",
                        what=named.description,
                        parameter=parameter,
                        filter=f"{width_of:g}",
                        used=f"{usual:g}",
                    )
                )
        if named is not None and named.type in _FILTERS:
            description.defaults["filter"] = _FILTERS[named.type]
        else:
            description.defaults["filter"] = "tent"  # closer to Mitsuba's Gaussian than Blackman-Harris, which is half as wide
            if named is not None and named.type != "gaussian":
                document.ignore(
                    Sentence(
                        "pixel-filter-replaced", "{what}: pixels are filtered by a tent of two pixels", what=named.description
                    )
                )
    elif (window.width, window.height) != (description.defaults["width"], description.defaults["height"]):
        document.ignore(
            Sentence(
                "mitsuba-film-sizes-differ",
                "The film sizes of later sensors are ignored: all pictures have the size of the first",
            )
        )
    return width, height, window


def _window(film: Element, width: int, height: int) -> Window:
    """Returns the film's crop window. Raises SceneError if it exceeds the film."""
    x, y = (int(film.number(f"crop_offset_{axis}", 0)) for axis in "xy")
    across, down = int(film.number("crop_width", width)), int(film.number("crop_height", height))
    if not (0 <= x < x + across <= width and 0 <= y < y + down <= height):
        raise SceneError(
            Sentence(
                "mitsuba-crop-outside-film",
                "{file}: {what}: its crop window is outside of its {width}x{height} pixels",
                file=film.file,
                what=film.description,
                width=width,
                height=height,
            )
        )
    return Window(x, y, across, down)


def add_integrator(source: Element, document: Document, description: SceneDescription) -> None:
    """Sets the scene's integrator and its settings."""
    inner = next(iter(source.children_of("integrator")), None)
    source.mark_used()
    if inner is not None:
        add_integrator(inner, document, description)
        return
    if source.boolean("hide_emitters", False):
        document.ignore(
            Sentence(
                "mitsuba-hide-emitters-ignored", "{what}: hide_emitters is ignored; lights are visible", what=source.description
            )
        )
    if source.type == "direct":
        description.defaults["integrator"] = "direct"
        return
    if source.type not in ("path", "volpath", "volpathmis"):
        document.ignore(Sentence("integrator-replaced", "{what}: rendered by path tracing", what=source.description))
    depth = int(source.number("max_depth", -1))
    description.defaults["max_depth"] = _UNBOUNDED if depth < 0 else min(max(depth, 1), MAX_DEPTH)
    if depth >= 0:
        description.defaults["transmission_depth"] = 0  # Mitsuba counts every bounce


def note_far_clipping(source: Element, document: Document, description: SceneDescription) -> None:
    """Adds a note if a camera's far clipping distance, which is ignored, would cut off part of the scene."""
    far = source.number("far_clip", 1e4)
    eye, forward = source.matrix()[:3, 3], source.matrix()[:3, 2]
    forward = forward / max(float(np.linalg.norm(forward)), 1e-300)
    corners = [np.array(sphere.center) + forward * sphere.radius for sphere in description.spheres]
    for instance in description.instances:
        points = description.meshes[instance.mesh].positions
        box = np.array(list(itertools.product(*np.stack([points.min(axis=0), points.max(axis=0)], axis=1))), np.float64)
        corners += list(box @ instance.transform[:3, :3].T + instance.transform[:3, 3])
    if corners and ((np.array(corners) - eye) @ forward).max() > far:
        document.ignore(Sentence("mitsuba-far-clip-ignored", "{what}: its far_clip is ignored", what=source.description))


def _vec(vector: np.ndarray) -> Vec3:
    x, y, z = (float(v) for v in vector)
    return x, y, z
