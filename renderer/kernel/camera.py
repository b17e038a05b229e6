"""The camera: maps a film point and a lens sample to a ray."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import KEY_COLUMNS
from renderer.bvh.motion import step_at, transform_at
from renderer.bvh.rigid_motion import motion_keys
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.distortion import undistorted
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.sampling.warp import square_to_disk
from renderer.settings import PROJECTIONS, RenderSettings, View
from renderer.trigonometry import sin_cos
from renderer.wide.lanes import each_lane
from renderer.wide.values import as_wide3, zero_like

__all__ = [
    "ORTHOGRAPHIC",
    "PANORAMA",
    "PERSPECTIVE",
    "Camera",
    "axes_of",
    "camera_frame",
    "camera_ray",
    "distortion_row",
    "exposure_time",
    "moving_ray",
    "readout_of",
]

PERSPECTIVE, ORTHOGRAPHIC, PANORAMA = (np.int32(PROJECTIONS.index(n)) for n in ("perspective", "orthographic", "panorama"))

_ZERO = np.float32(0.0)
Vector = tuple[np.float32, np.float32, np.float32]


class Camera(NamedTuple):
    """A camera's view in the form that kernels read.

    Numbers are float32 except the kind; film points (x, y) are in pixels from the upper left. perspective: the point in focus for
    (x, y) is eye + focus * (corner + x * across + y * down); the components of corner, across and down along the line of sight
    are 1, 0, 0. orthographic: the ray starts at eye + corner + x * across + y * down, in direction `forward`. panorama: longitude
    and latitude are `turns` times the offset of x and y from the middle.
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
    middle: tuple[np.float32, np.float32]  # intersection of the line of sight with the film
    turns: tuple[np.float32, np.float32]  # a pixel of the panorama, in turns
    motion: npt.NDArray[np.float64]  # (K, KEY_COLUMNS) of right, up, back and eye (renderer/bvh/motion.py); or no rows
    lens: npt.NDArray[np.float64]  # (K, 6): a pixel's width, aperture, focus, near, middle 2
    distortion: npt.NDArray[np.float64]  # (1, 12) from LensDistortion.row; no rows: none
    readout: tuple[np.float32, np.float32, np.float32, np.float32]  # see `readout_of`


def camera_frame(settings: RenderSettings) -> Camera:
    """Returns the Camera for render settings: for their image size, their view, and the views at the shutter's keys, if any."""
    view = settings.view

    def vector(v: npt.NDArray[np.float64]) -> Vector:
        return np.float32(v[0]), np.float32(v[1]), np.float32(v[2])

    right, up, back, eye = axes_of(view)
    flat = view.projection == "orthographic"
    pixel, aperture, focus, near, *middle = _lens(view, settings)
    corner = up * (pixel * middle[1]) - right * (pixel * middle[0])
    exposure, first, across, down = readout_of(settings)
    return Camera(
        kind=np.int32(PROJECTIONS.index(view.projection)),
        eye=vector(eye),
        corner=vector(corner if flat else corner - back),
        across=vector(right * pixel),
        down=vector(-up * pixel),
        right=vector(right),
        up=vector(up),
        forward=vector(-back),
        aperture=np.float32(aperture),
        focus=np.float32(focus),
        near=np.float32(near),
        middle=(np.float32(middle[0]), np.float32(middle[1])),
        turns=(np.float32(1 / settings.width), np.float32(0.5 / settings.height)),
        motion=_motion(settings.views),
        lens=np.array([_lens(each, settings) for each in settings.views]).reshape(-1, 6),
        distortion=distortion_row(view, settings.width, settings.height),
        readout=(np.float32(exposure), np.float32(first), np.float32(across), np.float32(down)),
    )


def readout_of(settings: RenderSettings) -> tuple[float, float, float, float]:
    """Returns the coefficients of `exposure_time`: of the random number, the constant, and per pixel in x and in y.

    A rolling shutter reads pixels out one row, or column, after the other in a share r of the shutter's time, and exposes each
    for the remaining 1 - r, as Cycles does with a rolling shutter duration of 1 - r.
    """
    share, edge = settings.rolling_shutter, settings.rolling_shutter_from
    is_backwards = edge in ("bottom", "right")
    across = edge in ("left", "right")
    step = share / (settings.width if across else settings.height) * (-1.0 if is_backwards else 1.0)
    first = share if is_backwards else 0.0
    x, y = (step, 0.0) if across else (0.0, step)
    return 1.0 - share, first, x, y


def distortion_row(view: View, width: int, height: int) -> npt.NDArray[np.float64]:
    """Returns the lens distortion of a view as kernels read it, (1, 12); no rows without one."""
    if view.distortion is None:
        return np.zeros((0, 12))
    return np.array([view.distortion.row(height / extent_at_one(view), view.middle(width, height))])


@functools.lru_cache(16)
def _motion(views: tuple[View, ...]) -> npt.NDArray[np.float64]:
    """Returns the keys of a camera that moves, (K, KEY_COLUMNS) float64, from its views while the shutter is open.

    The result is cached, since every batch of a frame needs it.
    """
    if not views:
        return np.zeros((0, KEY_COLUMNS))
    return np.ascontiguousarray(motion_keys(np.array([[np.stack(axes_of(each), -1) for each in views]]))[0])


def axes_of(view: View) -> tuple[npt.NDArray[np.float64], ...]:
    """Returns the columns of the camera's transform: the unit vectors right, up and back, and the eye, in world space."""
    eye = np.array(view.eye, np.float64)
    sight = np.array(view.target, np.float64) - eye
    forward = sight / _length(sight)
    right = np.cross(forward, np.array(view.up, np.float64))
    right = right / _length(right)
    return right, np.cross(right, forward), -forward, eye


def _length(vector: npt.NDArray[np.float64]) -> float:
    """Returns a vector's length, with the same bits on every host, unlike `@`."""
    x, y, z = vector.tolist()
    return math.sqrt((x * x + y * y) + z * z)


def extent_at_one(view: View) -> float:
    """Returns the visible height of a perspective view at distance 1."""
    sine, cosine = sin_cos(math.radians(view.fov) / 2.0)
    return 2.0 * sine / cosine


def _lens(view: View, settings: RenderSettings) -> tuple[float, float, float, float, float, float]:
    """Returns (pixel size, aperture, focus, near, x and y of the line of sight on the film in pixels).

    The pixel size is measured at distance 1; for an orthographic view it is in scene units.
    """
    width, height = settings.width, settings.height
    extent = view.height if view.projection == "orthographic" else extent_at_one(view)
    aperture = view.aperture if view.projection == "perspective" else 0.0
    sight = np.array(view.target, np.float64) - np.array(view.eye, np.float64)
    focus = _length(sight) if view.focus is None else view.focus
    return extent / height, aperture, focus, view.near, *view.middle(width, height)


@device
def _panorama_ray(camera, x, y):
    sine, cosine = sincos_turns((x - camera.middle[0]) * camera.turns[0])
    rise, level = sincos_turns((camera.middle[1] - y) * camera.turns[1])
    d = vec.to_world(camera.right, camera.up, camera.forward, (level * sine, rise, level * cosine))
    return as_wide3(camera.eye, x), vec.normalize(d), zero_like(x)


@device
def _lens_ray(camera, towards, u):
    """Returns a ray through a thin lens: (origin, unit direction) in world space.

    All rays of a film point intersect in the plane of focus (Cook et al. 1984).
    """
    a, b = square_to_disk(u)
    lens = vec.add(vec.scale(camera.right, a * camera.aperture), vec.scale(camera.up, b * camera.aperture))
    return vec.add(camera.eye, lens), vec.normalize(vec.sub(vec.scale(towards, camera.focus), lens))


@device
def camera_ray(camera, x, y, u):
    """Returns the ray through film point (x, y) in pixels: (origin, unit direction, distance from the lens to the origin).

    u: two numbers in [0, 1) that select the point on the lens. For one sample or for eight lanes.
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
    start = zero_like(x)
    if camera.near > _ZERO:
        start = camera.near / vec.dot(d, camera.forward)
        o = vec.add(o, vec.scale(d, start))
    return o, d, start


@device
def _of_lens(camera, column, step, share):
    a = camera.lens[step, column]
    return np.float32(a + np.float64(share) * (camera.lens[step + 1, column] - a))


@subroutine
def _camera_at(camera, x, y, u, v, time):
    """Returns the `camera_ray` of a moving camera, interpolated to a shutter time.

    u, v: two numbers that select the lens point.
    """
    a, b, c = transform_at(camera.motion, 0, len(camera.motion), time)
    step, share = step_at(time, len(camera.motion))
    pixel = _of_lens(camera, 0, step, share)
    right = np.float32(a[0]), np.float32(b[0]), np.float32(c[0])
    up = np.float32(a[1]), np.float32(b[1]), np.float32(c[1])
    forward = -np.float32(a[2]), -np.float32(b[2]), -np.float32(c[2])
    middle = _of_lens(camera, 4, step, share), _of_lens(camera, 5, step, share)
    corner = vec.sub(vec.scale(up, pixel * middle[1]), vec.scale(right, pixel * middle[0]))
    if camera.kind != ORTHOGRAPHIC:
        corner = vec.add(forward, corner)
    now = Camera(
        camera.kind,
        (np.float32(a[3]), np.float32(b[3]), np.float32(c[3])),
        corner,
        vec.scale(right, pixel),
        vec.scale(up, -pixel),
        right,
        up,
        forward,
        _of_lens(camera, 1, step, share),
        _of_lens(camera, 2, step, share),
        _of_lens(camera, 3, step, share),
        middle,
        camera.turns,
        camera.motion,
        camera.lens,
        camera.distortion,
        camera.readout,
    )
    return camera_ray(now, x, y, (u, v))


@subroutine
def _distorted_ray(camera, x, y, time):
    """Returns the ray through a film point of a camera with lens distortion, as `camera_ray` does."""
    a, b, c, _ = undistorted(camera.distortion, 0, np.float64(x), np.float64(y))
    right, up, forward, eye, near = camera.right, camera.up, camera.forward, camera.eye, camera.near
    if len(camera.motion) > 0:
        p, q, r = transform_at(camera.motion, 0, len(camera.motion), time)
        step, share = step_at(time, len(camera.motion))
        right = np.float32(p[0]), np.float32(q[0]), np.float32(r[0])
        up = np.float32(p[1]), np.float32(q[1]), np.float32(r[1])
        forward = -np.float32(p[2]), -np.float32(q[2]), -np.float32(r[2])
        eye = np.float32(p[3]), np.float32(q[3]), np.float32(r[3])
        near = _of_lens(camera, 3, step, share)
    length = math.sqrt(a * a + b * b + c * c)
    along = np.float32(c / length)
    d = vec.normalize(vec.to_world(right, up, forward, (np.float32(a / length), -np.float32(b / length), along)))
    start = _ZERO
    if near > _ZERO and along > _ZERO:
        start = near / along
        eye = vec.add(eye, vec.scale(d, start))
    return eye, d, start


@device
def exposure_time(camera, x, y, u):
    """Returns the shutter time, 0 ... 1, at which a pixel with the centre (x, y) is exposed.

    u: a number in [0, 1), uniform over the pixel's exposure; without a rolling shutter it is the time. For one sample or for
    eight lanes.
    """
    exposure, first, across, down = camera.readout
    return u * exposure + first + x * across + y * down


@device
def moving_ray(camera, x, y, u, time):
    """Returns `camera_ray` at a shutter time, 0 ... 1, for a camera that may move, or whose lens distorts.

    For one sample or for eight lanes.
    """
    if len(camera.distortion) > 0:
        return each_lane(_distorted_ray, x == x, (camera, x, y, time))
    if len(camera.motion) > 0:
        return each_lane(_camera_at, x == x, (camera, x, y, u[0], u[1], time))
    return camera_ray(camera, x, y, u)
