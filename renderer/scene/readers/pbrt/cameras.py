"""Cameras of pbrt, and the render settings in its film, sampler and integrator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from renderer.errors import SettingsError
from renderer.scene.description import Camera, SceneDescription, Vec3
from renderer.scene.matrices import Matrix
from renderer.scene.readers.crop_window import Window, cropped
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.spectra import balanced
from renderer.sentences import Sentence
from renderer.settings import MAX_DEPTH, MAX_SIZE, MAX_SPP, View

__all__ = [
    *("FILTER", "MIRROR", "add_camera", "balance_of", "exposure_of", "mirrors"),
    *("set_film", "set_filter", "set_integrator", "set_sampler"),
]

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
_FILM = (1280, 720)
_FAR = 1e6
# A tent of two pixels is closer to pbrt's Gaussian than our Blackman-Harris, which is half as wide.
_FILTERS = {"box": "box", "triangle": "tent", "gaussian": "tent"}
FILTER = "tent"  # default
_SAMPLERS = ("halton", "independent", "paddedsobol", "pmj02bn", "sobol", "stratified", "zsobol")
# These affect only the choice of samples.
_IGNORED_SAMPLER_PARAMETERS = ("seed", "randomization", "jitter", "pixelsamples", "xsamples", "ysamples")
_IGNORED_FILM_PARAMETERS = (
    "filename",
    "savefp16",
    "diagonal",
    "coordinatesystem",
    "buckets",
    "nbuckets",
    "lambdamin",
    "lambdamax",
)


def mirrors(source: Parameters | None, to_world: Matrix) -> bool:
    """Returns True if the scene must be mirrored so that a camera in a right-handed world shows the same picture.

    source: the camera's parameters; to_world: (4, 4) from camera space.
    """
    axes = to_world[:3, :3]
    is_left_handed = float((axes[:, 0] * np.cross(axes[:, 1], axes[:, 2])).sum()) > 0
    # A spherical camera's image runs in the opposite direction.
    return is_left_handed != (source is not None and source.type == "spherical")


def exposure_of(camera: Parameters | None, film: Parameters | None) -> float:
    """Returns the film's exposure factor: |shutter time in seconds| * ISO / 100.

    Raises SceneError unless it is above 0 and finite.
    """
    seconds = camera.number("shutterclose", 1.0) - camera.number("shutteropen", 0.0) if camera is not None else 1.0
    speed = film.number("iso", 100.0) if film is not None else 100.0
    found = abs(seconds) * speed / 100
    if not 0 < found < 1e9:
        raise (film or camera).place.error(  # type: ignore[union-attr]
            Sentence(
                "pbrt-film-exposure-zero",
                "the film multiplies light by {factor}; give an iso above 0, and a shutterclose after shutteropen",
                factor=f"{found:g}",
            )
        )
    return found


def set_film(source: Parameters, description: SceneDescription, notes: Notes) -> Window:
    """Sets the image size from the film's parameters; returns the window of the image to render."""
    for key, name, default in (("width", "xresolution", _FILM[0]), ("height", "yresolution", _FILM[1])):
        size = source.integer(name, default)
        if size < 1:
            raise source.place.error(
                Sentence("pbrt-size-too-small", "{name} is {value}; it must be at least 1", name=name, value=size)
            )
        description.defaults[key] = min(size, MAX_SIZE)
    if source.type not in ("rgb", "gbuffer"):
        notes.add(
            source.place,
            Sentence("film-type-replaced", "{what}: is replaced by a film of linear RGB", what=source),
        )
    sensor = source.text("sensor", "cie1931")
    if sensor != "cie1931":
        notes.add(
            source.place,
            Sentence(
                "pbrt-film-sensor-replaced",
                "The sensor {sensor} of the film is replaced by the CIE observer",
                sensor=repr(sensor[:40]),
            ),
        )
    source.used.update(_IGNORED_FILM_PARAMETERS)
    return _film_window(source, description.defaults["width"], description.defaults["height"])


def _film_window(source: Parameters, width: int, height: int) -> Window:
    """Returns the window given by pixelbounds or cropwindow, clipped to the film.

    Raises SceneError if it is empty or malformed.
    """
    bounds, window = source.numbers("pixelbounds", "integer"), source.numbers("cropwindow", "float")
    if bounds is not None and len(bounds) == 4:
        ends = [int(v) for v in bounds]
    elif window is not None and len(window) == 4:
        sizes = (width, width, height, height)
        ends = [math.ceil(min(max(float(v), 0.0), 1.0) * size) for v, size in zip(window, sizes, strict=True)]
    elif bounds is None and window is None:
        return Window(0, 0, width, height)
    else:
        raise source.place.error(
            Sentence(
                "pbrt-pixel-bounds-malformed",
                "pixelbounds and cropwindow need four numbers: left, right, top and bottom",
            )
        )
    left, right, top, bottom = max(ends[0], 0), min(ends[1], width), max(ends[2], 0), min(ends[3], height)
    if not (left < right and top < bottom):
        raise source.place.error(
            Sentence(
                "pbrt-pixel-bounds-empty",
                "pixelbounds or cropwindow leave no pixel of the film of {width}x{height}; correct them",
                width=width,
                height=height,
            )
        )
    return Window(left, top, right - left, bottom - top)


def set_sampler(source: Parameters, description: SceneDescription, notes: Notes) -> None:
    """Sets the number of samples per pixel."""
    if source.type not in _SAMPLERS:
        notes.add(
            source.place,
            Sentence(
                "sampler-unknown",
                "{what} is unknown: only its sample count is used",
                what=source,
            ),
        )
    count = source.integer("pixelsamples", 16)
    if source.type == "stratified":
        count = source.integer("xsamples", 4) * source.integer("ysamples", 4)
    description.defaults["spp"] = min(max(count, 1), MAX_SPP)
    source.used.update(_IGNORED_SAMPLER_PARAMETERS)


def balance_of(film: Parameters | None, notes: Notes) -> Matrix | None:
    """Returns the (3, 3) matrix of the film's white balance in linear Rec.709; None without a white balance."""
    kelvin = film.number("whitebalance", 0.0) if film is not None else 0.0
    if film is None or not kelvin > 0:
        return None
    if not 1000 <= kelvin <= 1e5:
        raise film.place.error(
            Sentence(
                "pbrt-white-balance-invalid",
                "whitebalance is {kelvin} kelvins; give a temperature from 1000 to 100000",
                kelvin=f"{kelvin:g}",
            )
        )
    notes.add(
        film.place,
        Sentence(
            "pbrt-white-balance-differs",
            "whitebalance is applied to lights: strongly coloured surfaces look slightly different",
        ),
    )
    return balanced(kelvin, film.space)


def set_filter(source: Parameters, description: SceneDescription, notes: Notes) -> None:
    """Sets the pixel filter; a note is added if pbrt's filter is replaced."""
    description.defaults["filter"] = _FILTERS.get(source.type, FILTER)
    if source.type not in _FILTERS:
        notes.add(
            source.place,
            Sentence("pixel-filter-replaced", "{what}: pixels are filtered by a tent of two pixels", what=source),
        )
    elif source.type == "triangle":
        radii = [source.number(f"{axis}radius", 2.0) for axis in "xy"]
        if radii != [1.0, 1.0]:
            notes.add(
                source.place,
                Sentence(
                    "pbrt-filter-size-ignored",
                    "{source} is rendered two pixels wide, not {width} by {height}",
                    source=source,
                    width=f"{2 * radii[0]:g}",
                    height=f"{2 * radii[1]:g}",
                ),
            )
    source.used.add("")  # so that its parameters are reported as unused


def set_integrator(source: Parameters, description: SceneDescription, notes: Notes) -> None:
    """Sets the integrator and its depth. pbrt's depth counts bounces; the `depth` setting here counts path segments."""
    if source.type in ("ambientocclusion", "ao"):
        description.defaults["integrator"] = "ao"
        distance = source.number("maxdistance", math.inf)
        if 0 < distance < 1e15:
            description.defaults["ao_distance"] = distance
        source.used.add("cossample")
        return
    if source.type not in ("path", "volpath", "simplepath", "simplevolpath", "randomwalk"):
        notes.add(source.place, Sentence("integrator-replaced", "{what}: rendered by path tracing", what=source))
    if source.boolean("regularize", False):
        notes.add(
            source.place,
            Sentence("pbrt-regularize-ignored", "regularize of the integrator is ignored"),
        )
    description.defaults["max_depth"] = min(max(source.integer("maxdepth", 5) + 1, 1), MAX_DEPTH)
    description.defaults["transmission_depth"] = 0  # pbrt counts every bounce
    source.used.update(source.values)


def add_camera(
    source: Parameters, to_world: Matrix, description: SceneDescription, notes: Notes, rendered: Window | None = None
) -> None:
    """Adds the camera to the description.

    to_world: (4, 4) from camera space, which looks along +Z with +Y up. rendered: window of the film to render; None for all.
    """
    width, height = (description.defaults.get(key, size) for key, size in zip(("width", "height"), _FILM, strict=True))
    right, up, forward, eye = (to_world[:3, k] for k in range(4))
    fields: dict[str, Any] = {"eye": _vec(eye), "target": _vec(eye + _unit(forward)), "up": _vec(_unit(up))}
    axis = int(np.argmax(np.abs(up)))
    description.up = _vec(np.sign(up[axis]) * np.eye(3)[axis])  # the nearest world axis
    left, right_end, low, high = _window(source, width / height, notes)
    shift: dict[str, Any] = {"shift_x": (left + right_end) / 2 / (high - low), "shift_y": (low + high) / 2 / (high - low)}
    source.used.update(("shutteropen", "shutterclose"))
    if source.type == "orthographic":
        tall = (high - low) * float(np.linalg.norm(up))
        if source.number("lensradius", 0.0) > 0:
            notes.add(
                source.place,
                Sentence(
                    "pbrt-orthographic-focus-ignored", "The focus of an orthographic camera is ignored: it is sharp everywhere"
                ),
            )
        source.used.add("focaldistance")
        fields |= {"projection": "orthographic", "height": tall, **shift}
    elif source.type == "spherical":
        if source.text("mapping", "equalarea") != "equirectangular":
            notes.add(
                source.place,
                Sentence(
                    "pbrt-spherical-mapping-differs",
                    "The picture of a spherical camera is equirectangular, not equal-area",
                ),
            )
        fields |= {"projection": "panorama", "target": _vec(eye - _unit(right))}
    else:
        fov = source.number("fov", 90.0)
        if source.type != "perspective":
            notes.add(
                source.place,
                Sentence(
                    "pbrt-realistic-camera-replaced",
                    "{source} is replaced by a perspective camera of 40 degrees; its lenses are ignored",
                    source=source,
                ),
            )
            source.used.update(source.values)
            fov = 40.0
        half = math.tan(math.radians(min(max(fov, 1e-3), 179.0)) / 2) * (high - low) / 2
        fields |= shift
        fields["fov"] = min(max(math.degrees(2 * math.atan(half)), 0.01), 179.0)
        lens = source.number("lensradius", 0.0) * float(np.linalg.norm(right))
        focus = source.number("focaldistance", _FAR) * float(np.linalg.norm(forward))
        if lens > 0 and focus > 0:
            fields |= {"aperture": lens, "focus": focus}
    if rendered is not None and rendered != Window(0, 0, width, height):
        if source.type == "spherical":
            notes.add(
                source.place,
                Sentence(
                    "pbrt-spherical-window-ignored",
                    "The film window of a spherical camera is ignored: the whole picture is rendered",
                ),
            )
        else:
            description.defaults["width"], description.defaults["height"] = rendered.width, rendered.height
            fields = cropped(fields, (width, height), rendered)
    try:
        description.cameras.append(Camera(source.type, View(**fields)))
    except SettingsError as error:
        notes.add(source.place, Sentence("camera-sees-nothing", "{what} has an invalid view: {error}", what=source, error=error))


def _window(source: Parameters, ratio: float, notes: Notes) -> tuple[float, float, float, float]:
    """Returns the camera's screen window as (left, right, bottom, top); by default that of pbrt for the frame's aspect ratio.

    ratio: the image's width / height.
    """
    frame = source.number("frameaspectratio", ratio)
    if not frame > 0:
        raise source.place.error(
            Sentence(
                "pbrt-frame-aspect-ratio-invalid",
                "frameaspectratio of {source} is {value}; it must be above 0",
                source=source,
                value=f"{frame:g}",
            )
        )
    window = (-frame, frame, -1.0, 1.0) if frame > 1 else (-1.0, 1.0, -1 / frame, 1 / frame)
    said = source.numbers("screenwindow", "float")
    if said is not None:
        if len(said) != 4 or not said[0] < said[1] or not said[2] < said[3]:
            raise source.place.error(
                Sentence("pbrt-screen-window-malformed", "screenwindow needs four numbers: left, right, low and high")
            )
        window = (float(said[0]), float(said[1]), float(said[2]), float(said[3]))
    left, right, low, high = window
    if abs((right - left) / (high - low) / ratio - 1) > 1e-3:
        notes.add(
            source.place,
            Sentence(
                "pbrt-screen-window-shape-ignored",
                "The picture's aspect ratio differs from screenwindow or frameaspectratio: it is not stretched",
            ),
        )
    return window


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def _vec(vector: np.ndarray) -> Vec3:
    x, y, z = (float(v) for v in vector)
    return x, y, z
