"""A scene file's lights without a body, its environment, and the medium around everything."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from renderer.scene.description import Environment, Light, Medium, SceneDescription, Sky, Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.presets import light_by_name
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import color, radiance, vec3
from renderer.scene.textures import TextureShelf

__all__ = ["read_environment", "read_light", "read_medium"]

_FIELDS = {
    "point": {"position", "radius", "facing"},
    "spot": {"position", "direction", "target", "radius", "facing", "inner_cone", "outer_cone", "falloff"},
    "directional": {"direction", "angle", "seen"},
}
_ALL = {"type", "name", "intensity", "color"}


def read_light(source: dict[str, Any], index: int, document: Yaml, path: Path) -> Light:
    """The light at a place of `lights`. Raises SceneError for fields that its type does not know or lacks."""
    kind = source["type"]
    for key in source:
        if key not in _ALL | _FIELDS[kind]:
            raise document.error((*path, key), f"means nothing for a {kind} light")
    light = Light(kind, name=source.get("name", f"light {index}"))
    r, g, b = (i * c for i, c in zip(radiance(source.get("intensity", 1)), radiance(source.get("color", 1)), strict=True))
    light.intensity = (r, g, b)
    if kind != "directional" and "position" not in source:
        raise document.error(path, f"a {kind} light has a position")
    light.position = vec3(source.get("position", (0, 0, 0)))
    if kind != "point":
        light.direction = _direction(source, light.position, document, path)
    light.radius, light.angle = float(source.get("radius", 0)), float(source.get("angle", 0))
    light.outer_cone = float(source.get("outer_cone", 45))
    light.inner_cone = float(source.get("inner_cone", 0))
    light.falloff = source.get("falloff", "squared")
    light.facing, light.seen = source.get("facing", False), source.get("seen", "never")
    if light.inner_cone > light.outer_cone:
        raise document.error((*path, "inner_cone"), f"is wider than the outer cone of {light.outer_cone:g} degrees")
    return light


def _direction(source: dict[str, Any], position: Vec3, document: Yaml, path: Path) -> Vec3:
    if ("direction" in source) == ("target" in source):
        what = "one of direction and target" if source["type"] == "spot" else "a direction"
        raise document.error(path, f"a {source['type']} light has {what}")
    direction = np.array(source["direction"] if "direction" in source else np.subtract(source["target"], position), np.float64)
    length = float(np.linalg.norm(direction))
    if length < 1e-12:
        raise document.error((*path, "direction" if "direction" in source else "target"), "gives no direction")
    return vec3(direction / length)


def read_environment(source: dict[str, Any], document: Yaml, files: SceneFiles, shelf: TextureShelf) -> Environment:
    """What is under `environment`."""
    if sum(name in source for name in ("image", "sky", "preset")) > 1:
        raise document.error(("environment",), "has one of image, sky and preset")
    image = None
    if "image" in source:
        name = files.find(source["image"], document.file)
        if name is None:
            raise document.error(("environment", "image"), f"{source['image'][:120]} is not among the files; add it")
        image = shelf.image_file(name)
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
    """What is under `medium`."""
    return Medium(radiance(source.get("sigma_a", 0)), radiance(source.get("sigma_s", 0)), float(source.get("g", 0)))
