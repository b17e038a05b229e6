"""Motion vectors: the motion in the image, in pixels, of each pixel's surface point between frames.

They are a separate pass with one ray per pixel, and not a plane of the film: a film stores means over samples, and at an edge the
mean of two objects' motion is the motion of neither. So an image's cost and bits do not depend on whether vectors are requested.

The scene is compiled as if the shutter were open from the previous frame to the next (`renderer.scene.animation.BETWEEN`), which
includes all motion that motion blur includes, and is rendered at the middle.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer import jit
from renderer.arrays.kernel_variant import moving_variant, strip_absent_features
from renderer.arrays.scene import example
from renderer.bvh.traverse import new_stack
from renderer.kernel.camera import axes_of, camera_frame, distortion_row, extent_at_one
from renderer.kernel.distortion import FISHEYE, brown_formula, fisheye_formula, undistort_points
from renderer.kernel.vectors import in_camera_space, trace_motion_points
from renderer.reference import Packed
from renderer.scene.compiled import CompiledScene
from renderer.scene.origin import settings_relative_to_origin
from renderer.settings import RenderSettings, View
from renderer.threads import Team, parts_of

__all__ = ["border_angles", "load_kernel", "load_projection", "motion_vectors", "projected"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

_KERNEL = "vectors"
_ROWS = 16  # rows of pixels per part
_MAX_OFFSET = 1e7  # pixels
_BORDER = 65  # points on a side of a picture's border


def motion_vectors(scene: CompiledScene, settings: RenderSettings, threads: int | None = None) -> F32:
    """Returns motion vectors, (h, w, 4) float32: x and y in pixels, to the right and upwards, as in Cycles' Vector pass.

    First two: from the point's position in this frame to that in the previous one. Last two: from the point's position in the
    next frame to that in this one. For uniform motion both are equal. 0 where the point is behind the camera at that time.

    scene: compiled from `Shot.between_frames`, or a static one. settings: their view is the frame's; if the camera moves, their
    views are those of the previous, this and the next frame. threads: None for one per core.
    """
    sharp = [replace(view, aperture=0.0) for view in settings.views]
    settings = replace(settings, view=replace(settings.view, aperture=0.0), views=tuple(sharp))
    settings = settings_relative_to_origin(settings, scene.origin)
    views = [settings.views[k] for k in (0, len(sharp) // 2, -1)] if sharp else [settings.view] * 3
    places = np.empty((settings.height, settings.width, 3, 4))
    prepared, camera = Packed(strip_absent_features(scene, moving_variant(scene))), camera_frame(settings)

    def trace_part(part: tuple[int, int]) -> None:
        trace_motion_points(prepared, new_stack(), camera, part[0], places[part[0] : part[1]])

    parts = parts_of(0, settings.height, _ROWS)
    if not jit.is_ready(_KERNEL):
        load_kernel()
    with Team(threads) as team:
        team.each(trace_part, parts)
    before, now, after = (projected(views[k], settings, places[:, :, k]) for k in range(3))
    found = np.concatenate([_pixel_offsets(now, before, settings, views), _pixel_offsets(after, now, settings, views)], axis=2)
    return found.astype(np.float32)


def load_kernel() -> None:
    """Compiles or loads the kernel for motion vectors."""
    nothing = RenderSettings(1, 1, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    with jit.compiling(_KERNEL):
        trace_motion_points(
            Packed(strip_absent_features(example(), moving_variant(example()))),
            new_stack(),
            camera_frame(nothing),
            0,
            np.empty((0, 1, 3, 4)),
        )
        load_projection()


def load_projection() -> None:
    """Compiles or loads the kernel of `projected`."""
    in_camera_space(np.empty((0, 1, 4)), np.empty((3, 3)), np.empty(3), np.empty((3, 0, 1)))


def _pixel_offsets(start: F64, end: F64, settings: RenderSettings, views: list[View]) -> F64:
    """Returns the offsets (h, w, 2) in pixels between two sets of positions, y upwards.

    They are 0 where a position is invalid or too far away.
    """
    way = end - start
    if views[1].projection == "panorama":
        way[..., 0] -= settings.width * np.rint(way[..., 0] / settings.width)  # the shorter way around the panorama
    way[..., 1] = -way[..., 1]
    nowhere = ~(np.abs(way) < _MAX_OFFSET).all(axis=2)
    way[nowhere] = 0.0
    return way + 0.0  # no -0


def projected(view: View, settings: RenderSettings, places: F64) -> F64:
    """Projects points to pixel positions, (h, w, 2), from the image's upper left corner, y downwards; NaN behind the camera.

    places: (h, w, 4), points with w = 1, or directions with w = 0. Uses products, quotients and roots only.
    """
    found = np.empty((3, *places.shape[:2]))
    in_camera_space(np.ascontiguousarray(places), *_axes_and_eye(view), found)
    x, y, z = found
    middle, height = view.middle(settings.width, settings.height), settings.height
    with np.errstate(divide="ignore", invalid="ignore"):
        if view.projection == "panorama":
            turn, rise = _angle(x, z), _angle(y, np.sqrt(x * x + z * z))
            across, down = turn / (2.0 * math.pi) * settings.width, -rise / math.pi * height
        elif view.projection == "orthographic":
            pixel = view.height / height
            across, down = places[..., 3] * x / pixel, places[..., 3] * -y / pixel  # infinitely distant points do not move
        elif view.distortion is not None:
            across, down = _distorted(view, settings, x, -y, z)
        else:
            pixel = extent_at_one(view) / height
            behind = z <= 0
            z = np.where(behind, np.nan, z)
            across, down = x / z / pixel, -y / z / pixel
    ends = np.empty((*x.shape, 2))
    ends[..., 0], ends[..., 1] = middle[0] + across, middle[1] + down
    return ends


@functools.lru_cache(16)
def _axes_and_eye(view: View) -> tuple[F64, F64]:
    """Returns the unit vectors right, up and forward (3, 3), a row each, and the eye (3,). They must not be changed."""
    right, up, back, eye = axes_of(view)
    return np.stack([right, up, -back]), eye


def _distorted(view: View, settings: RenderSettings, x: F64, y: F64, z: F64) -> tuple[F64, F64]:
    """Projects points of the camera's space, y down and z along the line of sight, through a lens with distortion.

    Returns the offsets from the middle in pixels; NaN beyond the angles that the picture shows, where polynomials may fold back.
    """
    row = distortion_row(view, settings.width, settings.height)
    around = np.sqrt(x * x + y * y)
    angle = _angle(around, z)
    shown = angle <= _widest_angle(view, settings.width, settings.height)
    if row[0, 0] == FISHEYE:
        distance, _ = fisheye_formula(row, 0, angle)
        share = np.where(around > 0, distance / around, 0.0)
        across, down = x * share, y * share
    else:
        z = np.where(z > 0, z, np.nan)
        across, down = brown_formula(row, 0, x / z, y / z)[:2]
    focal = row[0, 1]
    return np.where(shown, across * focal, np.nan), np.where(shown, down * focal, np.nan)


@functools.lru_cache(16)
def _widest_angle(view: View, width: int, height: int) -> float:
    """Returns the greatest angle from the line of sight, in radians, on a distorted picture's border, and 1 % more."""
    found = border_angles(view, width, height)
    return 1.01 * max((each for each in found if each is not None), default=math.pi)


def border_angles(view: View, width: int, height: int) -> list[float | None]:
    """Returns the angles from the line of sight of points on a distorted picture's border; None where nothing is seen."""
    row = distortion_row(view, width, height)
    ends = [(x, y) for x in np.linspace(0, width, _BORDER) for y in (0, height)]
    ends += [(x, y) for y in np.linspace(0, height, _BORDER) for x in (0, width)]
    directions = np.empty((len(ends), 4))
    undistort_points(row, np.array(ends, np.float64), directions)
    return [math.atan2(math.hypot(a, b), c) if is_there else None for a, b, c, is_there in directions.tolist()]


def _angle(y: F64, x: F64) -> F64:
    """Returns arctan2(y, x) in radians, with the same bits on every host."""
    low, high = np.minimum(abs(x), abs(y)), np.maximum(abs(x), abs(y))
    tangent = low / np.maximum(high, 1e-300)
    for _ in range(2):  # halving twice brings the angle below pi / 16, where the series converges fast
        tangent = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
    square, total = tangent * tangent, np.zeros_like(tangent)
    for k in reversed(range(12)):
        total = total * square + (-1.0) ** k / (2 * k + 1)
    angle = 4.0 * tangent * total
    angle = np.where(abs(y) > abs(x), math.pi / 2 - angle, angle)
    angle = np.where(x < 0, math.pi - angle, angle)
    return np.where(y < 0, -angle, angle)
