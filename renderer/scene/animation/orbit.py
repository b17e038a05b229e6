"""Computes a turntable camera, which circles its target from frame to frame and also while the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from renderer.scene.animation.moment import Moment
from renderer.scene.animation.shutter import Shutter
from renderer.settings import MOST_KEYS, Vec3, View
from renderer.trigonometry import sin_cos

__all__ = ["orbit", "orbit_over"]

_KEYS_A_TURN = 32  # keys per full turn while the shutter is open


def orbit(view: View, turns: float, axis: Sequence[float] = (0.0, 1.0, 0.0)) -> View:
    """Returns the view moved along a circle about its target, counter-clockwise seen from the tip of the axis.

    turns: 1 is a full circle, which ends exactly at the start. axis: the scene's up direction, not 0.
    """
    if float(turns).is_integer():
        return view
    x, y, z = axis
    length = math.sqrt((x * x + y * y) + z * z)
    unit = (x / length, y / length, z / length)
    sine, cosine = sin_cos(2.0 * math.pi * (turns - math.floor(turns)))
    (tx, ty, tz), (ex, ey, ez) = view.target, view.eye
    ax, ay, az = _rotate((ex - tx, ey - ty, ez - tz), unit, sine, cosine)
    return replace(view, eye=(tx + ax, ty + ay, tz + az), up=_rotate(view.up, unit, sine, cosine))


def orbit_over(
    view: View,
    views: Sequence[View],
    moment: Moment,
    shutter: Shutter,
    fps: float,
    seconds: float,
    axis: Sequence[float] = (0.0, 1.0, 0.0),
) -> tuple[View, ...]:
    """Returns the views of a turntable camera while the shutter is open; empty if the shutter has no duration.

    views: the camera's own motion while the shutter is open, if any. fps: the file's frame rate. seconds: duration of a full
    turn.
    """
    if shutter.length == 0:
        return ()
    turns = shutter.length / ((moment.fps or fps) * seconds)
    keys = len(views) or shutter.keys or min(max(5, 2 + int(turns * _KEYS_A_TURN)), MOST_KEYS)
    moments = (shutter.moment(moment, i / (keys - 1)) for i in range(keys))
    start = views or (view,) * keys
    return tuple(orbit(each, when.seconds(fps) / seconds, axis) for each, when in zip(start, moments, strict=True))


def _rotate(v: Vec3, axis: Vec3, sine: float, cosine: float) -> Vec3:
    """Rotates a vector about an axis by Rodrigues' formula."""
    (x, y, z), (a, b, c) = v, axis
    along = ((a * x + b * y) + c * z) * (1.0 - cosine)
    return (
        (x * cosine + (b * z - c * y) * sine) + a * along,
        (y * cosine + (c * x - a * z) * sine) + b * along,
        (z * cosine + (a * y - b * x) * sine) + c * along,
    )
