"""A camera that goes around what it looks at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from renderer.scene.animation.trigonometry import sin_cos
from renderer.settings import Vec3, View

__all__ = ["orbit"]


def orbit(view: View, turns: float, axis: Sequence[float] = (0.0, 1.0, 0.0)) -> View:
    """The view from further along a circle about its target, counter-clockwise seen from where the axis points.

    turns: 1 is all the way round, which is exactly where it began. axis: which way is up in the scene, not 0.
    """
    if float(turns).is_integer():
        return view
    x, y, z = axis
    length = math.sqrt((x * x + y * y) + z * z)
    unit = (x / length, y / length, z / length)
    sine, cosine = sin_cos(2.0 * math.pi * (turns - math.floor(turns)))
    (tx, ty, tz), (ex, ey, ez) = view.target, view.eye
    ax, ay, az = _turned((ex - tx, ey - ty, ez - tz), unit, sine, cosine)
    return replace(view, eye=(tx + ax, ty + ay, tz + az), up=_turned(view.up, unit, sine, cosine))


def _turned(v: Vec3, axis: Vec3, sine: float, cosine: float) -> Vec3:
    """Rodrigues' formula."""
    (x, y, z), (a, b, c) = v, axis
    along = ((a * x + b * y) + c * z) * (1.0 - cosine)
    return (
        (x * cosine + (b * z - c * y) * sine) + a * along,
        (y * cosine + (c * x - a * z) * sine) + b * along,
        (z * cosine + (a * y - b * x) * sine) + c * along,
    )
