"""Colours and vectors as a scene file writes them."""

from __future__ import annotations

from typing import Any

from renderer.scene.description import Vec3

__all__ = ["color", "radiance", "srgb_bytes", "vec3"]


def vec3(values: Any) -> Vec3:
    """Three numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def radiance(value: Any) -> Vec3:
    """Linear RGB, of three numbers or one for grey."""
    return vec3(value if isinstance(value, list | tuple) else [value] * 3)


def color(value: Any) -> Vec3:
    """Linear RGB, of numbers or of sRGB as '#rrggbb'."""
    if not isinstance(value, str):
        return radiance(value)
    encoded = [int(value[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return vec3([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded])


def srgb_bytes(linear: Vec3) -> list[int]:
    """The nearest sRGB colour of 8 bits a channel."""
    return [round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055)) for c in linear]
