"""Clamps a file's numbers to valid ranges."""

from __future__ import annotations

import math
from collections.abc import Iterable

from renderer.scene.description import Vec3

__all__ = ["blended_cone", "clamped", "unit", "unit_color"]


def clamped(value: float, low: float, high: float) -> float:
    """Returns the value clamped to low..high."""
    return min(max(value, low), high)


def unit(value: float) -> float:
    """Returns the value clamped to 0..1."""
    return clamped(value, 0.0, 1.0)


def unit_color(values: Iterable[float], high: float = 1.0) -> Vec3:
    """Returns three numbers, each clamped to 0..high."""
    r, g, b = (clamped(v, 0.0, high) for v in values)
    return r, g, b


def blended_cone(outer: float, blend: float) -> float:
    """Returns the inner half angle, in degrees, of a Blender spot. outer: outer half angle in degrees; blend: 0..1."""
    edge = math.cos(math.radians(outer))
    return min(math.degrees(math.acos(min(edge + (1 - edge) * blend, 1.0))), outer)
