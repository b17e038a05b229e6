"""Computes the camera ray of a sample, with the sample's time and random number stream."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel.camera import camera_ray, exposure_time, moving_ray
from renderer.kernel.sampling.filter import filter_offset
from renderer.kernel.sampling.sampler import draw_film, pixel_key
from renderer.kernel.steps.random_blocks import draw_time
from renderer.kernel.steps.state import stream_of
from renderer.prune_absent_features import where_present
from renderer.wide.values import to_float

__all__ = ["CameraRay", "spawn_camera_ray"]

_HALF = np.float32(0.5)


class CameraRay(NamedTuple):
    """A sample's ray from the camera, with its time and random numbers."""

    o: Any
    d: Any  # unit
    start: Any  # distance of o from the lens
    time: Any  # shutter time, 0 ... 1; None in a scene without motion
    stream: Any  # the sample's random numbers


@device
def spawn_camera_ray(motion, camera, options, x, y, sample):
    """Returns the CameraRay of a sample of pixel (x, y).

    motion: None for a scene without motion (renderer/arrays/scene_features.py). sample: its number, uint32.
    """
    stream = stream_of(options, pixel_key(x, y), sample)
    u = draw_film(stream)
    film_x = to_float(x) + _HALF + filter_offset(options.filter, u[0])
    film_y = to_float(y) + _HALF + filter_offset(options.filter, u[1])
    time = where_present(motion, exposure_time(camera, to_float(x) + _HALF, to_float(y) + _HALF, draw_time(stream)))
    if motion is not None:
        o, d, start = moving_ray(camera, film_x, film_y, (u[2], u[3]), time)
    else:
        o, d, start = camera_ray(camera, film_x, film_y, (u[2], u[3]))
    return CameraRay(o, d, start, time, stream)
