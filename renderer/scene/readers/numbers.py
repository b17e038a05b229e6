"""Numbers of a file brought into the range that has a meaning, as viewers do, too."""

from __future__ import annotations

from collections.abc import Iterable

from renderer.scene.description import Vec3

__all__ = ["clamped", "unit", "unit_color"]


def clamped(value: float, low: float, high: float) -> float:
    """The nearest number from low to high."""
    return min(max(value, low), high)


def unit(value: float) -> float:
    """The nearest number from 0 to 1."""
    return clamped(value, 0.0, 1.0)


def unit_color(values: Iterable[float], high: float = 1.0) -> Vec3:
    """Three numbers, each brought into 0..high."""
    r, g, b = (clamped(v, 0.0, high) for v in values)
    return r, g, b
