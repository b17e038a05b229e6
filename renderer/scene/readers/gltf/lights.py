"""KHR_lights_punctual: point, spot and directional lights in photometric units."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import Light, LightKind, Vec3
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.transforms import Matrix, unit_vector, vec3
from renderer.scene.readers.light_maps import LUMENS_PER_WATT
from renderer.sentences import Sentence

__all__ = ["EXTENSION", "forward_of", "read_light"]

EXTENSION = "KHR_lights_punctual"

_KINDS: dict[str, LightKind] = {"point": "point", "spot": "spot", "directional": "directional"}
_MAX_INTENSITY = 1e12


def read_light(source: Json, name: str, world: Matrix) -> Light:
    """Returns the light on a node. The node's scale, and the light's range (a hint for rasterisers), are ignored."""
    kind = source.text("type", "")
    if kind not in _KINDS:
        raise source.damage(
            "type", Sentence("value-unknown", "is {value}; known are {choices}", value=repr(kind[:20]), choices=[*_KINDS])
        )
    color = [source.clamped("color", value, 0.0, 1.0) for value in source.vector("color", (1.0, 1.0, 1.0))]
    photometric = source.clamped("intensity", source.number("intensity", 1.0), 0.0, _MAX_INTENSITY)
    r, g, b = (c * photometric / LUMENS_PER_WATT for c in color)
    light = Light(_KINDS[kind], (r, g, b), position=vec3(world[:3, 3]), direction=forward_of(world), name=name)
    spot = source.object("spot")
    if kind == "spot":
        outer, inner = math.pi / 4, 0.0
        if spot is not None:
            outer = spot.clamped("outerConeAngle", spot.number("outerConeAngle", outer), 1e-4, math.pi / 2)
            inner = spot.clamped("innerConeAngle", spot.number("innerConeAngle", inner), 0.0, outer)
        light.inner_cone, light.outer_cone = math.degrees(inner), math.degrees(outer)
    return light


def forward_of(world: Matrix) -> Vec3:
    """Returns the unit direction of a light with the given transform: its -Z axis."""
    direction = -world[:3, 2]
    return vec3(unit_vector(direction)) if np.linalg.norm(direction) > 0 else (0.0, -1.0, 0.0)
