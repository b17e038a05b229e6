"""Lights without a body, and light from all around."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import Environment, Light, SceneDescription, Vec3
from renderer.scene.readers.linear import linear
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.skies import SKIES, sky_of
from renderer.scene.readers.mitsuba.textures import Textures, radiance_of
from renderer.scene.readers.turned_sky import FROM_PLUS_Z, seen_upright
from renderer.scene.textures import TextureShelf

__all__ = ["add_emitter"]


def add_emitter(source: Element, document: Document, shelf: TextureShelf, description: SceneDescription) -> None:
    """Adds an emitter of the scene to the description."""
    name = source.id or source.type
    world = source.matrix()
    if source.type == "constant":
        _surround(Environment(color=radiance_of(source, "radiance")), source, document, description)
    elif source.type == "envmap":
        _image(source, document, shelf, description)
    elif source.type == "point":
        position = source.get("position")
        place = world[:3, 3] if position is None else np.asarray(position, float)
        description.lights.append(Light("point", radiance_of(source, "intensity"), _vec(place), name=name))
    elif source.type == "spot":
        outer = min(max(source.number("cutoff_angle", 20.0), 0.01), 90.0)
        inner = min(max(source.number("beam_width", 0.75 * outer), 0.0), outer)
        tint = _mean_in_cone(source, document, shelf, inner, outer)
        r, g, b = (a * float(t) for a, t in zip(radiance_of(source, "intensity"), tint, strict=True))
        intensity: Vec3 = (r, g, b)
        direction = _vec(_unit(world[:3, 2]))
        description.lights.append(
            Light(
                "spot", intensity, _vec(world[:3, 3]), direction, inner_cone=inner, outer_cone=outer, falloff="linear", name=name
            )
        )
    elif source.type == "directional":
        direction = source.get("direction")
        towards = _unit(world[:3, 2] if direction is None else np.asarray(direction, float))
        description.lights.append(Light("directional", radiance_of(source, "irradiance"), direction=_vec(towards), name=name))
    elif source.type in SKIES:
        environment, sun = sky_of(source, document, shelf)
        if environment is not None:
            _surround(environment, source, document, description)
        if sun is not None:
            description.lights.append(sun)
    else:
        document.ignore(f"{source.what} is no light that is read: it is left out")


def _mean_in_cone(source: Element, document: Document, shelf: TextureShelf, inner: float, outer: float) -> Vec3:
    """The mean colour of the picture that a spot throws, by how bright it is where."""
    color, number = Textures(document, shelf).color(source, "texture", 1.0)
    if number is None:
        return color
    document.ignore(f"{source.what}: its texture is not thrown as a picture: it shines in the mean of its colours")
    pixels = linear(shelf.image_of(number))
    height, width = pixels.shape[:2]
    x, y = (2 * np.arange(width) + 1) / width - 1, (2 * np.arange(height) + 1) / height - 1
    slope = np.hypot(*np.meshgrid(x, y)) * math.tan(math.radians(min(outer, 89.0)))
    angle = np.degrees(np.arctan(slope))
    weight = np.clip((outer - angle) / max(outer - inner, 1e-6), 0, 1) * (1 + slope**2) ** -1.5
    red, green, blue = (pixels * weight[..., None]).sum(axis=(0, 1)) / max(float(weight.sum()), 1e-12)
    return float(red) * color[0], float(green) * color[1], float(blue) * color[2]


def _surround(environment: Environment, source: Element, document: Document, description: SceneDescription) -> None:
    if description.environment is not None:
        document.ignore(f"{source.what}: a scene has one light from all around; this one is left out")
        return
    description.environment = environment


def _image(source: Element, document: Document, shelf: TextureShelf, description: SceneDescription) -> None:
    wanted = str(source.get("filename", ""))
    name = document.files.find(wanted, source.file)
    if name is None:
        shelf.missing(wanted, source.what)
        return
    image = shelf.image_file(name)
    if image is None:
        return
    world = source.matrix()
    x, z = _unit(world[:3, 0]), _unit(world[:3, 2])
    strength = source.number("scale", 1.0)
    if abs(_unit(world[:3, 1])[1] - 1) > 1e-3 or np.linalg.det(world[:3, :3]) < 0:
        turn = np.stack([_unit(world[:3, k]) for k in range(3)], axis=1) @ FROM_PLUS_Z
        upright = shelf.add(seen_upright(description.images[image], turn))
        _surround(Environment(image=upright, strength=strength), source, document, description)
        return
    angle = math.degrees(math.atan2(z[0] - x[2], z[2] + x[0]))
    # The middle of Mitsuba's image looks along +Z, that of ours along -Z.
    _surround(Environment(image=image, strength=strength, rotation=(angle - 180.0) % 360), source, document, description)


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def _vec(vector: np.ndarray) -> Vec3:
    x, y, z = (float(v) for v in vector)
    return x, y, z
