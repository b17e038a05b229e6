"""Reads a scene file's lights without a surface, its environment, and its global medium."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any, get_args

import numpy as np

from renderer.scene.description import (
    F32,
    LIGHT_PARAMETERS,
    EmissionMap,
    Environment,
    Light,
    LightKind,
    Medium,
    SceneDescription,
    Sky,
    Vec3,
)
from renderer.scene.files import SceneFiles
from renderer.scene.parameters import SCATTERED_RAYS
from renderer.scene.presets import light_by_name
from renderer.scene.readers.light_maps import LUMENS_PER_WATT, all_around, photometry_of, projected_map
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import color, radiance, value_of, vec3
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, reason_of

__all__ = ["LIGHT_TYPES", "Lights", "read_environment", "read_medium"]

_SHAPED = {"profile", "picture", "up"}
_AIMED = {"position", "direction", "target"}
# Fields per type of light, in addition to LIGHT_PARAMETERS and those of all lights.
_PLACED = {
    "point": {*_AIMED, *_SHAPED},
    "spot": {*_AIMED, *_SHAPED},
    "projector": {*_AIMED, "picture", "up", "fov"},
    "directional": {"direction"},
}
LIGHT_TYPES = tuple(dict.fromkeys((*_PLACED, *get_args(LightKind))))
_ALL = {"type", "name", "intensity", "color", "visible_to"}
_FIELDS = {
    kind: {*_ALL, *_PLACED.get(kind, _AIMED), *(p.in_file for p in LIGHT_PARAMETERS if kind in p.kinds)} for kind in LIGHT_TYPES
}
_WIDEST = 89.0  # maximum half angle of an image in degrees


class Lights:
    """Reads a scene file's lights, with their images and IES profiles."""

    def __init__(self, document: Yaml, files: SceneFiles, shelf: TextureShelf, description: SceneDescription) -> None:
        self._document, self._files, self._shelf, self._description = document, files, shelf, description

    def read(self, source: dict[str, Any], index: int, path: Path) -> Light:
        """Returns a light. index: its index in `lights`, for its default name.

        Raises SceneError if a field is required by the light's type and missing, or has no meaning for it.
        """
        kind, document = source["type"], self._document
        for key in source:
            if key not in _FIELDS[kind]:
                raise document.error(
                    (*path, key),
                    Sentence("light-parameter-meaningless", "has no meaning for a {kind} light; leave it out", kind=kind),
                )
        light = Light("point" if kind == "projector" else kind, name=source.get("name", f"light {index}"))
        r, g, b = (i * c for i, c in zip(radiance(source.get("intensity", 1)), radiance(source.get("color", 1)), strict=True))
        light.intensity = (r, g, b)
        if kind != "directional" and "position" not in source:
            raise document.error(path, Sentence("light-position-missing", "a {kind} light needs a position", kind=kind))
        light.position = vec3(source.get("position", (0, 0, 0)))
        if kind != "point" or "direction" in source or "target" in source:
            light.direction = _direction(source, light.position, document, path)
        elif "picture" in source:
            light.direction = (0.0, 0.0, -1.0)
        for parameter in LIGHT_PARAMETERS:
            if parameter.in_file in source:
                setattr(light, parameter.name, value_of(parameter, source[parameter.in_file]))
        seen_by = source.get("visible_to", SCATTERED_RAYS)
        light.hidden_from = tuple(ray for ray in SCATTERED_RAYS if ray not in seen_by)
        light.up = vec3(source.get("up", light.up))
        if light.inner_cone > light.outer_cone:
            raise document.error(
                (*path, "inner_cone"),
                Sentence(
                    "spot-inner-cone-too-wide",
                    "is wider than the outer cone of {outer_cone} degrees",
                    outer_cone=f"{light.outer_cone:g}",
                ),
            )
        return self._with_emission_map(light, source, path)

    def _with_emission_map(self, light: Light, source: dict[str, Any], path: Path) -> Light:
        """Returns the light with the emission map of its image or IES profile."""
        kind, document = source["type"], self._document
        if "profile" in source and "picture" in source:
            raise document.error(
                (*path, "picture"),
                Sentence("light-profile-conflict", "cannot be combined with a profile; leave one of them out"),
            )
        if kind == "projector" and "picture" not in source:
            raise document.error(path, Sentence("projector-picture-missing", "a projector needs a picture"))
        if kind == "point" and not source.keys() & {"profile", "picture"}:
            for key in ("direction", "target", "up"):
                if key in source:
                    raise document.error(
                        (*path, key),
                        Sentence(
                            "point-light-parameter-meaningless",
                            "has no meaning for a point light without a profile or picture; leave it out",
                        ),
                    )
        if "profile" in source:
            photometry = photometry_of(self._files, self._find_file(source, "profile", path))
            self._description.warnings += [note for note in photometry.notes if note not in self._description.warnings]
            r, g, b = (value / LUMENS_PER_WATT for value in light.intensity)
            return replace(light, intensity=(r, g, b), emission=photometry.emission)
        if "picture" not in source:
            return light
        number = self._shelf.image_file(self._find_file(source, "picture", path))
        if number is None:
            raise document.error((*path, "picture"), Sentence("light-picture-unreadable", "could not be read; give an image"))
        image = self._description.images[number]
        known = "picture of a light", kind, id(image.pixels), source.get("fov"), light.outer_cone
        if kind == "point":
            top = tuple(float(v) for v in np.cross(np.cross(light.direction, light.up), light.direction))
            if not any(top):
                raise document.error(
                    (*path, "up"),
                    Sentence(
                        "light-up-along-direction", "is parallel to the light's direction; give the up direction of its picture"
                    ),
                )
            x, y, z = light.direction
            made = self._files.get_or_make(known, lambda: (all_around(linear(image)), image.pixels))
            return replace(light, emission=made[0], direction=vec3(top), up=(-x, -y, -z))
        half = light.outer_cone if kind == "spot" else float(source.get("fov", 40)) / 2
        if half > _WIDEST:
            raise document.error(
                path,
                Sentence(
                    "projector-cone-too-wide",
                    "makes a picture wider than {most} degrees; make its cone narrower",
                    most=f"{2 * _WIDEST:g}",
                ),
            )
        made = self._files.get_or_make(
            known, lambda: (_image_emission_map(linear(image), kind, math.tan(math.radians(half))), image.pixels)
        )
        return replace(light, emission=made[0])

    def _find_file(self, source: dict[str, Any], field: str, path: Path) -> str:
        name = self._files.find(source[field], self._document.file)
        if name is None:
            raise self._document.error(
                (*path, field),
                Sentence("file-missing", "{name} is not among the files; add it", name=source[field][:120]),
            )
        return name


def _image_emission_map(pixels: F32, kind: str, half: float) -> EmissionMap:
    """Returns the emission map of the image of a spot or projector.

    A spot's image is scaled so that its smaller side fills the cone; a projector's image illuminates a plane evenly.
    half: tangent of half the angle that the image covers.
    """
    height, width = pixels.shape[:2]
    if kind == "projector":
        return projected_map(pixels, half * width / height, half, "screen")
    return projected_map(pixels, half * max(1.0, width / height), half * max(1.0, height / width))


def _direction(source: dict[str, Any], position: Vec3, document: Yaml, path: Path) -> Vec3:
    if ("direction" in source) == ("target" in source):
        raise document.error(
            path,
            Sentence("light-direction-required", "a directional light needs a direction")
            if source["type"] == "directional"
            else Sentence(
                "light-direction-choice", "a {kind} light needs a direction or a target, not both", kind=source["type"]
            ),
        )
    direction = np.array(source["direction"] if "direction" in source else np.subtract(source["target"], position), np.float64)
    length = float(np.linalg.norm(direction))
    if length < 1e-12:
        raise document.error(
            (*path, "direction" if "direction" in source else "target"),
            Sentence("light-direction-zero", "has length 0 and gives no direction"),
        )
    return vec3(direction / length)


def read_environment(source: dict[str, Any], document: Yaml, files: SceneFiles, shelf: TextureShelf) -> Environment:
    """Returns the environment described by the file's `environment`. Raises SceneError if it is invalid."""
    if sum(name in source for name in ("image", "sky", "preset")) > 1:
        raise document.error(
            ("environment",), Sentence("environment-source-choice", "has more than one of image, sky and preset; give one")
        )
    image = None
    if "image" in source:
        name = files.find(source["image"], document.file)
        if name is None:
            raise document.error(
                ("environment", "image"),
                Sentence("file-missing", "{name} is not among the files; add it", name=source["image"][:120]),
            )
        image = shelf.environment_file(name, space=source.get("colorspace", ""))
        if image is None:
            reason = reason_of(shelf.last_warning)
            raise document.error(
                ("environment", "image"),
                Sentence("environment-file-unreadable", "cannot be read: {error}; give an .exr or .hdr image", error=reason),
            )
    fields = dict(source["sky"]) if "sky" in source else None
    if "preset" in source:
        by_name = SceneDescription(name="light")
        light_by_name(source["preset"], by_name)
        light = by_name.environment or Environment()
        image = shelf.add(by_name.images[light.image]) if light.image is not None else None
        fields = asdict(light.sky) if light.sky is not None else None
    if fields and "ground_albedo" in fields:
        fields["ground_albedo"] = color(fields["ground_albedo"])
    return Environment(
        color=radiance(source.get("color", 1.0)),
        image=image,
        strength=float(source.get("strength", 1)),
        rotation=float(source.get("rotation", 0)),
        sky=None if fields is None else Sky(**fields),
    )


def read_medium(source: dict[str, Any]) -> Medium:
    """Returns the medium described by the file's `medium`."""
    return Medium(
        radiance(source.get("sigma_a", 0)),
        radiance(source.get("sigma_s", 0)),
        float(source.get("g", 0)),
        source.get("volume", ""),
    )
