"""Direction of a pixel's camera ray, computed as by the kernel's camera (renderer/kernel/camera.py)."""

from __future__ import annotations

import math

from renderer.view import Vec3, View

__all__ = ["pixel_direction"]


def pixel_direction(view: View, width: int, height: int, x: float, y: float) -> Vec3:
    """Returns the unit direction in world space from the eye through film point (x, y), in pixels from the upper left corner."""
    forward = _unit(_difference(view.target, view.eye))
    right = _unit(_cross(forward, view.up))
    up = _cross(right, forward)
    if view.projection == "orthographic":
        return forward
    if view.projection == "panorama":
        around = (x - width / 2) / width * 2 * math.pi
        rise = (height / 2 - y) / height * math.pi
        level = math.cos(rise)
        return _weighted_sum((level * math.sin(around), right), (math.sin(rise), up), (level * math.cos(around), forward))
    pixel = 2 * math.tan(math.radians(view.fov) / 2) / height
    middle = view.middle(width, height)
    return _unit(_weighted_sum(((x - middle[0]) * pixel, right), ((middle[1] - y) * pixel, up), (1.0, forward)))


def _difference(a: Vec3, b: Vec3) -> Vec3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Vec3) -> Vec3:
    length = math.hypot(*a)
    return a[0] / length, a[1] / length, a[2] / length


def _weighted_sum(*parts: tuple[float, Vec3]) -> Vec3:
    x, y, z = (sum(share * vector[axis] for share, vector in parts) for axis in range(3))
    return x, y, z
