"""Measures edges in pixels: on the screen of a scene's only camera, or as if their object filled a picture's height."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from renderer.kernel.camera import axes_of, extent_at_one
from renderer.scene.description import SceneDescription
from renderer.scene.displacement.dicing import Measure
from renderer.view import View

__all__ = ["object_lengths", "only_camera", "screen_lengths"]

F64 = npt.NDArray[np.float64]

_HEIGHT, _ASPECT = 1080, 16 / 9  # of pictures, unless the file has a size
_OFFSCREEN = 4.0  # by how much edges may be longer outside of the picture
_MARGIN = 0.1  # picture sizes around the picture over which they become that long
_MOST_PLACES = 8  # instances of a mesh that are measured: the nearest


def only_camera(description: SceneDescription) -> View | None:
    """Returns the view of the file's camera, if it has one and neither other frames nor variations show another.

    The frames of a shot share static geometry, which therefore must not depend on the camera of one frame.
    """
    if len(description.cameras) != 1 or description.moves or description.variation:
        return None
    return description.cameras[0].view


def object_lengths(points: F64, rate: float) -> Measure:
    """Returns a measure of edges relative to `rate` pixels, where the object's bounding box has a diagonal of 1080 pixels.

    points: (V, 3) of the object.
    """
    extent = np.ptp(points, axis=0)
    diagonal = math.sqrt(sum(float(each) * float(each) for each in extent))
    scale = _HEIGHT / (rate * max(diagonal, 1e-300))
    return lambda at: np.concatenate([at.T, np.full((1, len(at)), scale)])[None]


def screen_lengths(description: SceneDescription, view: View, places: Sequence[F64], points: F64, rate: float) -> Measure:
    """Returns a measure of edges relative to `rate` pixels of the picture, the largest over the instances of a mesh.

    Edges are measured as if they were parallel to the screen, so that they stay short where displaced surfaces are seen from the
    side. Outside of the picture they may be longer. places: (4, 4) transforms of the instances. points: (V, 3) of the mesh.
    """
    height = float(description.defaults.get("height") or _HEIGHT)
    aspect = float(description.defaults.get("width") or height * _ASPECT) / height
    right, up, back, eye = axes_of(view)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    distances = [float(_lengths(_placed(place, middle[None]) - eye)[0]) for place in places]
    nearest = sorted(range(len(places)), key=lambda n: (distances[n], n))[:_MOST_PLACES]
    near = max(view.near, 1e-6 * float(_lengths((np.array(view.target) - eye)[None])[0]))

    def pixels(points: F64) -> F64:
        """Returns (V,) how many pixels a unit is long at world-space points."""
        at = points - eye
        distance = np.maximum(_lengths(at), near)
        if view.projection == "panorama":
            return np.asarray(height / math.pi / distance)
        x, y, z = (_along(at, axis) for axis in (right, up, back))
        if view.projection == "orthographic":
            size, found = np.full(len(at), view.height), np.full(len(at), height / view.height)
        else:
            at_one = extent_at_one(view)
            size, found = np.maximum(-z, near) * at_one, height / at_one / distance
        outside = np.maximum(np.abs(x / size - view.shift_x) - aspect / 2, np.abs(y / size - view.shift_y) - 0.5)
        coarser = 1 + (_OFFSCREEN - 1) * np.clip(np.where(z > 0, 1.0, outside / _MARGIN), 0.0, 1.0)
        return np.asarray(found / coarser)

    def measure(at: F64) -> F64:
        found = np.empty((len(nearest), 4, len(at)))
        for row, n in zip(found, nearest, strict=True):
            world = _placed(places[n], at)
            row[:3], row[3] = world.T, pixels(world) / rate
        return found

    return measure


def _placed(place: F64, points: F64) -> F64:
    x, y, z = points.T
    return np.stack([place[k, 0] * x + place[k, 1] * y + place[k, 2] * z + place[k, 3] for k in range(3)], axis=1)


def _along(points: F64, axis: F64) -> F64:
    return np.asarray(points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2])


def _lengths(vectors: F64) -> F64:
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z))
