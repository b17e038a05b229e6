"""Explains a pixel: renders its samples again and returns the paths of some of them, projected into the image."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.kernel.camera import axes_of
from renderer.luminance import luminance
from renderer.render import pixel_range_sums, pixel_samples, replay
from renderer.replay import Replay, Vertex
from renderer.scene.compiled import CompiledScene
from renderer.settings import RenderSettings, Vec3, View

__all__ = [
    "MODELS",
    "MOST_SAMPLES",
    "Bounce",
    "PixelPath",
    "PixelPaths",
    "ProjectedPoint",
    "bounce_of",
    "brightest_of_ranges",
    "pixel_paths",
    "projected_point",
]

MOST_SAMPLES = 16384  # the number of first samples that are examined
MOST_SINGLE = 1024  # the number of first samples that are rendered one by one, for the median
RANGE = 64  # later samples are rendered in ranges of this size, of which only the brightest are split

Choice = Literal["first", "median", "brightest", "asked"]
Bounce = Literal["reflected", "transmitted"]

MODELS = {kind.number: kind.model for kind in rows.KINDS if kind.model is not None}


class ProjectedPoint(NamedTuple):
    """A projected point in homogeneous coordinates: if w > 0, its pixel is (x / w, y / w) from the image's upper left corner.

    If w <= 0, the point is not in front of the camera. The segment between two points projects to the segment between their
    projections. A direction (a point at infinity) can be projected too.
    """

    x: float
    y: float
    w: float


@dataclass(frozen=True)
class PixelPath:
    """A sample of a pixel, chosen for display, with the sample's path projected into the image."""

    chosen: list[Choice]
    sample: int
    replay: Replay
    spots: list[ProjectedPoint]  # of each vertex, on the viewer's side; of the environment, in its direction
    lamps: list[ProjectedPoint | None]  # of the lights' points


@dataclass(frozen=True)
class PixelPaths:
    """The sum of a pixel's samples, and the paths of some of these samples.

    sums: the colours of samples 0 ... samples - 1, added in the film's fixed point. finite: how many of these samples were
    finite.
    """

    samples: int
    sums: tuple[int, int, int]
    finite: int
    paths: list[PixelPath]


def pixel_paths(
    scene: CompiledScene, settings: RenderSettings, x: int, y: int, count: int, sample_number: int | None = None
) -> PixelPaths:
    """Renders a pixel's first `count` samples (at most MOST_SAMPLES); returns their sum, and the paths of some of them.

    These are the first sample, that of median brightness among the first MOST_SINGLE, and the brightest of all. sample_number:
    the number of a further sample whose path is returned; it need not be below `count`. Raises SettingsError if the pixel or the
    sample is out of range.
    """
    count = min(count, MOST_SAMPLES)
    single = min(count, MOST_SINGLE)
    values, is_finite = pixel_samples(scene, settings, x, y, single)
    ranges = [(first, min(RANGE, count - first)) for first in range(single, count, RANGE)]
    sums, finite = pixel_range_sums(scene, settings, x, y, ranges)
    chosen: dict[int, list[Choice]] = {}
    if sample_number is not None:
        chosen[sample_number] = ["asked"]
    chosen.setdefault(0, []).append("first")
    if count > 0:
        light = _brightness(values, is_finite)
        order = np.argsort(light, kind="stable")
        chosen.setdefault(int(order[(single - 1) // 2]), []).append("median")
        bounds = _brightness(sums, finite == [samples for _, samples in ranges])
        brightest = brightest_of_ranges(
            (int(order[-1]), float(light[order[-1]])),
            [(first, samples, float(bound)) for (first, samples), bound in zip(ranges, bounds, strict=True)],
            lambda first, samples: _brightness(*_single_samples(scene, settings, x, y, first, samples)),
        )
        chosen.setdefault(brightest, []).append("brightest")
    paths = []
    for sample, roles in chosen.items():
        found = replay(scene, settings, x, y, sample)
        paths.append(PixelPath(roles, sample, found, *_project_path(settings, found)))
    red, green, blue = (int(v) for v in values.sum(0) + sums.sum(0))
    return PixelPaths(count, (red, green, blue), int(is_finite.sum() + finite.sum()), paths)


def brightest_of_ranges(
    known: tuple[int, float],
    ranges: Sequence[tuple[int, int, float]],
    light_of: Callable[[int, int], npt.NDArray[np.float64]],
) -> int:
    """Returns the number of the brightest sample among a known one and those of several ranges.

    Samples are not darker than 0, so none is brighter than its range, and only ranges brighter than the brightest known sample
    are split. known: number and brightness of a sample. ranges: first sample, count, brightness of the sum. light_of: returns the
    brightness of each sample of a range, (count,).
    """
    sample, most = known
    for first, count, bound in sorted(ranges, key=lambda each: -each[2]):
        if bound <= most:
            break
        light = light_of(first, count)
        at = int(np.argmax(light))
        if light[at] > most:
            sample, most = first + at, float(light[at])
    return sample


def _single_samples(
    scene: CompiledScene, settings: RenderSettings, x: int, y: int, first: int, count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    values, finite = pixel_range_sums(scene, settings, x, y, [(first + i, 1) for i in range(count)])
    return values, finite == 1


def _brightness(values: npt.NDArray[np.int64], is_finite: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Returns the luminance of (n, 3) colours; infinite where a sample was not finite: users look for these."""
    return np.where(is_finite, luminance(values), np.inf)


def bounce_of(vertex: Vertex, following: Vertex | None) -> Bounce | None:
    """Returns whether a path was reflected or transmitted at a vertex.

    Returns None if the path ended there, or if the vertex is not on a surface. following: the path's next vertex.
    """
    if vertex.kind != "surface" or vertex.normal is None or following is None:
        return None
    return "reflected" if float(np.dot(vertex.normal, following.direction)) > 0 else "transmitted"


def _project_path(settings: RenderSettings, found: Replay) -> tuple[list[ProjectedPoint], list[ProjectedPoint | None]]:
    view = _view_at(settings, found.time)

    def spot(point: Vec3 | None, direction: Vec3) -> ProjectedPoint:
        return projected_point(view, settings.width, settings.height, point or direction, point is None)

    lamps = [None if v.lamp is None else spot(v.lamp.point, v.lamp.direction) for v in found.vertices]
    return [spot(v.point, v.direction) for v in found.vertices], lamps


def _view_at(settings: RenderSettings, time: float) -> View:
    """Returns the view of a moving camera at the shutter time nearest to `time` for which `settings.views` has one.

    Returns the only view if the camera does not move.
    """
    if not settings.views:
        return settings.view
    return settings.views[round(time * (len(settings.views) - 1))]


def projected_point(view: View, width: int, height: int, point: Vec3, is_far: bool = False) -> ProjectedPoint:
    """Projects a point, or a direction if `is_far`, through the centre of a view's lens."""
    right, up, back, eye = axes_of(view)
    away = np.array(point, np.float64) - (0.0 if is_far else eye)
    across, rise, ahead = float(away @ right), float(away @ up), -float(away @ back)
    if view.projection == "panorama":
        turn = math.atan2(across, ahead) / (2 * math.pi)
        climb = math.atan2(rise, math.hypot(across, ahead)) / math.pi
        return ProjectedPoint(width * (0.5 + turn), height * (0.5 - climb), 1.0)
    if view.projection == "orthographic":
        pixels, w = height / view.height, 0.0 if is_far else 1.0
    else:
        pixels, w = height / (2 * math.tan(math.radians(view.fov) / 2)), ahead
    x, y = view.middle(width, height)
    return ProjectedPoint(x * w + across * pixels, y * w - rise * pixels, w)
