"""The perspective camera: a pixel to a ray."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.jit import device
from renderer.kernel import vec
from renderer.settings import RenderSettings

__all__ = ["camera_frame", "camera_ray"]


def camera_frame(settings: RenderSettings) -> tuple[tuple[np.float32, ...], ...]:
    """(eye, corner, across, down): direction (x, y) is corner + x across + y down, x and y in pixels from the upper left."""
    view = settings.view

    def unit(v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return v / math.sqrt(float(v @ v))

    eye = np.array(view.eye, np.float64)
    forward = unit(np.array(view.target, np.float64) - eye)
    right = unit(np.cross(forward, np.array(view.up, np.float64)))
    up = np.cross(right, forward)
    pixel = 2.0 * math.tan(math.radians(view.fov) / 2.0) / settings.height
    corner = forward - right * (pixel * settings.width / 2.0) + up * (pixel * settings.height / 2.0)
    return tuple(tuple(np.float32(c) for c in v) for v in (eye, corner, right * pixel, -up * pixel))


@device
def camera_ray(frame, x, y):
    """The ray through the film's point (x, y), in pixels: (origin, unit direction)."""
    return frame[0], vec.normalize(vec.add(frame[1], vec.add(vec.scale(frame[2], x), vec.scale(frame[3], y))))
