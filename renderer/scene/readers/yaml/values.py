"""Converts values of a scene file: colours, vectors, declared parameters."""

from __future__ import annotations

import math
from typing import Any

from renderer.scene.description import Vec3
from renderer.scene.parameters import Parameter

__all__ = ["color", "radiance", "srgb_bytes", "value_of", "vec3"]


def vec3(values: Any) -> Vec3:
    """Returns three numbers as floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def radiance(value: Any) -> Vec3:
    """Returns linear RGB from three numbers, or from a single number as grey."""
    return vec3(value if isinstance(value, list | tuple) else [value] * 3)


def color(value: Any) -> Vec3:
    """Returns linear RGB from three linear numbers, a single number as grey, or sRGB as '#rrggbb'."""
    if not isinstance(value, str):
        return radiance(value)
    encoded = [int(value[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return vec3([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded])


def value_of(parameter: Parameter, value: Any) -> Any:
    """Converts a value in the file, which the schema has accepted, to the value of a declared parameter other than a texture."""
    match parameter.form:
        case "color":
            return color(value)
        case "radiance" | "triple":
            return radiance(value)
        case "pair":
            return tuple(value) if isinstance(value, list) else (0.0, float(value))
        case "degrees":
            return math.radians(value)
        case "number":
            return float(value)
    return value


def srgb_bytes(linear: Vec3) -> list[int]:
    """Returns the nearest 8-bit sRGB codes of a linear colour."""
    return [round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055)) for c in linear]
