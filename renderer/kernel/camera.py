"""The camera: a point of the film and one of the lens to a ray."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.sampling.warp import square_to_disk
from renderer.settings import PROJECTIONS, RenderSettings
from renderer.wide.values import as_wide3

__all__ = ["ORTHOGRAPHIC", "PANORAMA", "PERSPECTIVE", "Camera", "camera_frame", "camera_ray"]

PERSPECTIVE, ORTHOGRAPHIC, PANORAMA = (np.int32(PROJECTIONS.index(n)) for n in ("perspective", "orthographic", "panorama"))

_ZERO = np.float32(0.0)
Vector = tuple[np.float32, np.float32, np.float32]


class Camera(NamedTuple):
    """A view as the kernel reads it, float32 but for the kind. Film points (x, y) are in pixels from the upper left corner.

    perspective: the sharp point of (x, y) is eye + focus (corner + x across + y down), whose parts along the line of sight
    are 1, 0, 0. orthographic: the ray starts at eye + corner + x across + y down and runs along `forward`.
    panorama: longitude and latitude are `turns` times x and y from the middle.
    """

    kind: np.int32
    eye: Vector
    corner: Vector
    across: Vector
    down: Vector
    right: Vector  # unit
    up: Vector  # unit
    forward: Vector  # unit
    aperture: np.float32  # radius of the lens
    focus: np.float32  # along the line of sight
    near: np.float32  # along the line of sight, where rays start
    middle: tuple[np.float32, np.float32]  # of the film
    turns: tuple[np.float32, np.float32]  # a pixel of the panorama, in turns


def camera_frame(settings: RenderSettings) -> Camera:
    """The settings' view for their size of picture."""
    view = settings.view

    def unit(v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return v / math.sqrt(float(v @ v))

    def vector(v: npt.NDArray[np.float64]) -> Vector:
        return np.float32(v[0]), np.float32(v[1]), np.float32(v[2])

    eye = np.array(view.eye, np.float64)
    sight = np.array(view.target, np.float64) - eye
    forward = unit(sight)
    right = unit(np.cross(forward, np.array(view.up, np.float64)))
    up = np.cross(right, forward)
    flat = view.projection == "orthographic"
    pixel = (view.height if flat else 2.0 * math.tan(math.radians(view.fov) / 2.0)) / settings.height
    corner = up * (pixel * settings.height / 2.0) - right * (pixel * settings.width / 2.0)
    return Camera(
        kind=np.int32(PROJECTIONS.index(view.projection)),
        eye=vector(eye),
        corner=vector(corner if flat else forward + corner),
        across=vector(right * pixel),
        down=vector(-up * pixel),
        right=vector(right),
        up=vector(up),
        forward=vector(forward),
        aperture=np.float32(view.aperture if view.projection == "perspective" else 0.0),
        focus=np.float32(math.sqrt(float(sight @ sight)) if view.focus is None else view.focus),
        near=np.float32(view.near),
        middle=(np.float32(settings.width / 2), np.float32(settings.height / 2)),
        turns=(np.float32(1 / settings.width), np.float32(0.5 / settings.height)),
    )


@device
def _panorama_ray(camera, x, y):
    sine, cosine = sincos_turns((x - camera.middle[0]) * camera.turns[0])
    rise, level = sincos_turns((camera.middle[1] - y) * camera.turns[1])
    d = vec.to_world(camera.right, camera.up, camera.forward, (level * sine, rise, level * cosine))
    return as_wide3(camera.eye, x), vec.normalize(d)


@device
def _lens_ray(camera, towards, u):
    """A thin lens bends all rays of a film point to one point of the plane in focus (Cook et al. 1984)."""
    a, b = square_to_disk(u)
    lens = vec.add(vec.scale(camera.right, a * camera.aperture), vec.scale(camera.up, b * camera.aperture))
    return vec.add(camera.eye, lens), vec.normalize(vec.sub(vec.scale(towards, camera.focus), lens))


@device
def camera_ray(camera, x, y, u):
    """The ray through the film's point (x, y), in pixels, and the lens's point that u chooses: (origin, unit direction).

    Of one sample, or of eight.
    """
    if camera.kind == PANORAMA:
        return _panorama_ray(camera, x, y)
    towards = vec.add(camera.corner, vec.add(vec.scale(camera.across, x), vec.scale(camera.down, y)))
    if camera.kind == ORTHOGRAPHIC:
        o, d = vec.add(camera.eye, towards), as_wide3(camera.forward, x)
    elif camera.aperture > _ZERO:
        o, d = _lens_ray(camera, towards, u)
    else:
        o, d = as_wide3(camera.eye, x), vec.normalize(towards)
    if camera.near > _ZERO:
        o = vec.add(o, vec.scale(d, camera.near / vec.dot(d, camera.forward)))
    return o, d
