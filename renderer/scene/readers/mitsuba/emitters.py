"""Converts emitters: lights without a surface, and environment light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from renderer.scene.description import EmissionMap, Environment, Light, SceneDescription, Vec3
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.sensors import vertical_fov
from renderer.scene.readers.mitsuba.skies import SKIES, sky_of
from renderer.scene.readers.mitsuba.textures import Textures, radiance_of
from renderer.scene.readers.turned_sky import FROM_PLUS_Z, rotate_environment
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.sentences import Sentence

__all__ = ["add_emitter"]

_HALF_OF_50_MM = math.hypot(36, 24) / 2 / 50  # tangent of the diagonal half angle: a projector's default lens


def add_emitter(source: Element, document: Document, shelf: TextureShelf, description: SceneDescription) -> None:
    """Adds an emitter of the scene to the description."""
    name = source.id or source.type
    world = source.matrix()
    if source.type == "constant":
        _set_environment(Environment(color=radiance_of(source, "radiance", description.spectra)), source, document, description)
    elif source.type == "envmap":
        _image(source, document, shelf, description)
    elif source.type == "point":
        position = source.get("position")
        place = world[:3, 3] if position is None else np.asarray(position, float)
        description.lights.append(Light("point", radiance_of(source, "intensity", description.spectra), _vec(place), name=name))
    elif source.type == "spot":
        outer = min(max(source.number("cutoff_angle", 20.0), 0.01), 90.0)
        inner = min(max(source.number("beam_width", 0.75 * outer), 0.0), outer)
        color, emission = _spot_image(source, document, shelf, outer)
        r, g, b = (a * c for a, c in zip(radiance_of(source, "intensity", description.spectra), color, strict=True))
        light = Light("spot", (r, g, b), inner_cone=inner, outer_cone=outer, falloff="linear", emission=emission, name=name)
        description.lights.append(_in_world(light, world))
    elif source.type == "projector":
        description.lights.append(_projector(source, name, document, shelf))
    elif source.type == "directional":
        direction = source.get("direction")
        towards = _unit(world[:3, 2] if direction is None else np.asarray(direction, float))
        description.lights.append(
            Light("directional", radiance_of(source, "irradiance", description.spectra), direction=_vec(towards), name=name)
        )
    elif source.type in SKIES:
        environment, sun = sky_of(source, document, shelf)
        if environment is not None:
            _set_environment(environment, source, document, description)
        if sun is not None:
            description.lights.append(sun)
    else:
        document.ignore(
            Sentence("light-type-unsupported", "{what} is not supported as a light: it is left out", what=source.description)
        )


def _in_world(light: Light, world: np.ndarray) -> Light:
    """Returns a light, defined in its own space, with position and axes in world space.

    In its own space the light emits along +Z, with +Y up. world: (4, 4) transform to world space.
    """
    return replace(light, position=_vec(world[:3, 3]), direction=_vec(_unit(world[:3, 2])), up=_vec(_unit(world[:3, 1])))


def _spot_image(source: Element, document: Document, shelf: TextureShelf, outer: float) -> tuple[Vec3, EmissionMap | None]:
    """Returns a spot's colour and the emission map of its texture, or None.

    The texture fills the square around the spot's cone: its first column is at -X, its first row at -Y. outer: half angle in
    degrees.
    """
    color, number = Textures(document, shelf).color(source, "texture", 1.0)
    if number is None:
        return color, None
    half = math.tan(math.radians(min(outer, 89.0)))
    side = _handedness_sign(source)
    emission = EmissionMap("window", _pixels(source, number, document, shelf), (-half * side, half * side, -half, half))
    return color, emission


def _projector(source: Element, name: str, document: Document, shelf: TextureShelf) -> Light:
    """Returns a projector as a point light with an emission map.

    Its image is the irradiance, divided by pi, of the plane at distance 1, upright as seen along +Z.
    """
    color, number = Textures(document, shelf).color(source, "irradiance", 1.0)
    pixels = np.ones((1, 1, 3), np.float32) if number is None else _pixels(source, number, document, shelf)
    height, width = pixels.shape[:2]
    lens = source if source.get("fov") is not None or source.get("focal_length") is not None else None
    half = (
        math.tan(math.radians(vertical_fov(source, width, height)) / 2)
        if lens
        else _HALF_OF_50_MM / math.hypot(width / height, 1)
    )
    across = -_handedness_sign(source) * half * width / height
    scale = math.pi * source.number("scale", 1.0)
    r, g, b = (scale * c for c in color)
    emission = EmissionMap("screen", pixels, (-across, across, half, -half))
    return _in_world(Light("point", (r, g, b), emission=emission, name=name), source.matrix())


def _handedness_sign(source: Element) -> float:
    """Returns -1 for a right-handed emitter space, in which +X is to the left when looking along +Z; 1 for a mirrored one."""
    return 1.0 if np.linalg.det(source.matrix()[:3, :3]) < 0 else -1.0


def _pixels(source: Element, number: int, document: Document, shelf: TextureShelf) -> np.ndarray:
    if shelf.texture_of(number).transform != IDENTITY_UV_TRANSFORM:
        document.ignore(
            Sentence(
                "mitsuba-projector-texture-transform-ignored",
                "{what}: the transform of its texture is ignored",
                what=source.description,
            )
        )
    return np.maximum(linear(shelf.image_of(number)), 0)


def _set_environment(environment: Environment, source: Element, document: Document, description: SceneDescription) -> None:
    if description.environment is not None:
        document.ignore(
            Sentence(
                "mitsuba-second-environment-dropped",
                "{what}: a scene can have one environment; this one is left out",
                what=source.description,
            )
        )
        return
    description.environment = environment


def _image(source: Element, document: Document, shelf: TextureShelf, description: SceneDescription) -> None:
    wanted = str(source.get("filename", ""))
    name = document.files.find(wanted, source.file)
    if name is None:
        shelf.warn_of_missing(wanted, source.description)
        return
    image = shelf.environment_file(name)
    if image is None:
        return
    world = source.matrix()
    x, z = _unit(world[:3, 0]), _unit(world[:3, 2])
    strength = source.number("scale", 1.0)
    if abs(_unit(world[:3, 1])[1] - 1) > 1e-3 or np.linalg.det(world[:3, :3]) < 0:
        turn = np.stack([_unit(world[:3, k]) for k in range(3)], axis=1) @ FROM_PLUS_Z
        upright = shelf.add(rotate_environment(description.images[image], turn))
        _set_environment(Environment(image=upright, strength=strength), source, document, description)
        return
    angle = math.degrees(math.atan2(z[0] - x[2], z[2] + x[0]))
    # The centre of Mitsuba's image is at +Z; that of an environment image is at -Z.
    _set_environment(Environment(image=image, strength=strength, rotation=(angle - 180.0) % 360), source, document, description)


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def _vec(vector: np.ndarray) -> Vec3:
    x, y, z = (float(v) for v in vector)
    return x, y, z
