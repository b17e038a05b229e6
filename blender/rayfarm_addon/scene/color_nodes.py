"""Blender's colour and number operations, as in intern/cycles/kernel/svm, applied to whole arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["BLENDS", "MATH", "hsv", "rgb"]

F32 = npt.NDArray[np.float32]
LEAST = 1e-9


def hsv(c: F32) -> F32:
    """Converts (..., 3) RGB to hue, saturation and value."""
    most, least = c.max(axis=-1), c.min(axis=-1)
    delta = most - least
    safe = np.where(delta > 0, delta, 1)
    r, g, b = ((most - c[..., k]) / safe for k in range(3))
    hue = np.where(c[..., 0] == most, b - g, np.where(c[..., 1] == most, 2 + r - b, 4 + g - r)) / 6 % 1.0
    saturation = np.where(most != 0, delta / np.where(most != 0, most, 1), 0)
    return np.stack([np.where((delta > 0) & (saturation != 0), hue, 0), saturation, most], axis=-1)


def rgb(c: F32) -> F32:
    """Converts (..., 3) hue, saturation and value to RGB."""
    h, s, v = c[..., 0] % 1.0 * 6, c[..., 1], c[..., 2]
    which = np.floor(h).astype(np.int64) % 6
    f = h - np.floor(h)
    p, q, t = v * (1 - s), v * (1 - s * f), v * (1 - s * (1 - f))
    table = ((v, t, p), (q, v, p), (p, v, t), (p, q, v), (t, p, v), (v, p, q))
    return np.stack([np.choose(which, [row[k] for row in table]) for k in range(3)], axis=-1)


def _lerp(t: Any, a: Any, b: Any) -> Any:
    return a + t * (b - a)


def _overlay(t: Any, a: Any, b: Any) -> Any:
    low = a * ((1 - t) + 2 * t * b)
    return np.where(a < 0.5, low, 1 - ((1 - t) + 2 * t * (1 - b)) * (1 - a))


def _divide(t: Any, a: Any, b: Any) -> Any:
    return np.where(b != 0, (1 - t) * a + t * a / np.where(b != 0, b, 1), a)


def _dodge(t: Any, a: Any, b: Any) -> Any:
    rest = 1 - t * b
    return np.where(a == 0, 0, np.where(rest <= 0, 1, np.minimum(a / np.where(rest > 0, rest, 1), 1)))


def _burn(t: Any, a: Any, b: Any) -> Any:
    rest = (1 - t) + t * b
    return np.where(rest <= 0, 0, np.clip(1 - (1 - a) / np.where(rest > 0, rest, 1), 0, 1))


def _soft(t: Any, a: Any, b: Any) -> Any:
    screen = 1 - (1 - b) * (1 - a)
    return (1 - t) * a + t * ((1 - a) * b * a + a * screen)


def _hsv_blend(make: Callable[[F32, F32], tuple[Any, Any, Any]], by_hue: bool) -> Callable[..., Any]:
    def blend(t: Any, a: F32, b: F32) -> Any:
        a, b = (np.broadcast_to(each, (*each.shape[:-1], 3)) for each in (a, b))
        a, b = np.broadcast_arrays(a, b)
        first, second = hsv(a), hsv(b)
        changed = rgb(np.stack(make(first, second), axis=-1))
        judged = second if by_hue else first
        return np.where(judged[..., 1:2] != 0, _lerp(t, a, changed), a)

    return blend


# Blend functions of (share of the second, first, second).
BLENDS: dict[str, Callable[..., Any]] = {
    "MIX": _lerp,
    "ADD": lambda t, a, b: a + t * b,
    "MULTIPLY": lambda t, a, b: a * (1 - t + t * b),
    "SUBTRACT": lambda t, a, b: a - t * b,
    "SCREEN": lambda t, a, b: 1 - ((1 - t) + t * (1 - b)) * (1 - a),
    "DIVIDE": _divide,
    "DIFFERENCE": lambda t, a, b: _lerp(t, a, np.abs(a - b)),
    "EXCLUSION": lambda t, a, b: np.maximum(_lerp(t, a, a + b - 2 * a * b), 0),
    "DARKEN": lambda t, a, b: _lerp(t, a, np.minimum(a, b)),
    "LIGHTEN": lambda t, a, b: np.maximum(a, t * b),
    "OVERLAY": _overlay,
    "DODGE": _dodge,
    "BURN": _burn,
    "SOFT_LIGHT": _soft,
    "LINEAR_LIGHT": lambda t, a, b: a + t * (2 * b - 1),
    "HUE": _hsv_blend(lambda a, b: (b[..., 0], a[..., 1], a[..., 2]), True),
    "COLOR": _hsv_blend(lambda a, b: (b[..., 0], b[..., 1], a[..., 2]), True),
    "SATURATION": _hsv_blend(lambda a, b: (a[..., 0], b[..., 1], a[..., 2]), False),
}


def _power(a: Any, b: Any) -> Any:
    return np.where((a < 0) & (b != np.floor(b)), 0, np.power(np.where((a == 0) & (b < 0), 1, a), b))


def _modulo(a: Any, b: Any) -> Any:
    return np.where(b != 0, np.fmod(a, np.where(b != 0, b, 1)), 0)


MATH: dict[str, Callable[..., Any]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": lambda a, b: np.where(b != 0, a / np.where(b != 0, b, 1), 0),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": _power,
    "SQRT": lambda a: np.sqrt(np.maximum(a, 0)),
    "ABSOLUTE": lambda a: np.abs(a),
    "EXPONENT": lambda a: np.exp(a),
    "MINIMUM": lambda a, b: np.minimum(a, b),
    "MAXIMUM": lambda a, b: np.maximum(a, b),
    "LESS_THAN": lambda a, b: (a < b).astype(np.float32),
    "GREATER_THAN": lambda a, b: (a > b).astype(np.float32),
    "SIGN": lambda a: np.sign(a),
    "COMPARE": lambda a, b, c: (np.abs(a - b) <= np.maximum(c, 1e-5)).astype(np.float32),
    "ROUND": lambda a: np.floor(a + 0.5),
    "FLOOR": lambda a: np.floor(a),
    "CEIL": lambda a: np.ceil(a),
    "TRUNC": lambda a: np.trunc(a),
    "FRACT": lambda a: a - np.floor(a),
    "MODULO": _modulo,
    "FLOORED_MODULO": lambda a, b: np.where(b != 0, a - np.floor(a / np.where(b != 0, b, 1)) * b, 0),
    "SINE": lambda a: np.sin(a),
    "COSINE": lambda a: np.cos(a),
    "TANGENT": lambda a: np.tan(a),
    "RADIANS": lambda a: np.radians(a),
    "DEGREES": lambda a: np.degrees(a),
}
