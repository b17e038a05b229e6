"""Converts a projection matrix to the view of a job's request.

Projections that are not centred (a shifted lens, a border, a viewport through a camera) are requested with a lens shift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .model import to_y_up

__all__ = ["Lens", "Shot", "shot_of", "view_of"]

F64 = npt.NDArray[np.float64]
WIDEST = 178.9
MOST_SHIFT = 100.0
LEAST_SHIFT = 1e-6  # relative to the picture's height: smaller shifts are rounding errors


@dataclass(frozen=True)
class Lens:
    """Depth of field and clipping of a camera: lens radius, focus distance and near distance, in scene units."""

    aperture: float = 0.0
    focus: float | None = None
    near: float = 0.0


@dataclass(frozen=True)
class Shot:
    """A view to request from the farm, and the needed part of the requested image: x, y of the upper left corner, w, h."""

    view: dict[str, Any]
    width: int
    height: int
    x: int
    y: int
    w: int
    h: int

    @property
    def is_whole(self) -> bool:
        """True if the whole image is needed."""
        return (self.x, self.y, self.w, self.h) == (0, 0, self.width, self.height)

    def crop(self, picture: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Returns the needed part of the requested image (height, width, ...), rows from the top."""
        return picture[self.y : self.y + self.h, self.x : self.x + self.w]


def view_of(place: F64, projection: F64, share: float, lens: Lens) -> dict[str, Any]:
    """Returns the `view` field of a job's request.

    place: transform from the camera to Blender's world. share: ratio of the requested height to that of the projection.
    """
    eye, forward, above = place[:3, 3], -_unit(place[:3, 2]), _unit(place[:3, 1])
    # Far enough that eye and target differ in float32.
    target = eye + forward * max(1.0, float(np.abs(eye).max()))
    found: dict[str, Any] = {"eye": to_y_up(eye), "target": to_y_up(target), "up": to_y_up(above)}
    if projection[3, 3] == 0:
        fov = math.degrees(2 * math.atan(share / projection[1, 1]))
        found |= {"fov": min(max(fov, 0.01), WIDEST)}
        if lens.aperture > 0:
            found |= {"aperture": lens.aperture, "focus": max(lens.focus or 10.0, 1e-6)}
    else:
        found |= {"projection": "orthographic", "height": 2 * share / float(projection[1, 1])}
    if lens.near > 0:
        found["near"] = lens.near
    return found


def shot_of(
    place: F64, projection: F64, size: tuple[int, int], lens: Lens = Lens(), border: tuple[int, int, int, int] | None = None
) -> Shot:
    """Returns the Shot (view and needed part) for a projection matrix.

    place: transform from the camera to the world. size: width and height in pixels. border: the needed pixels x0, y0, x1, y1 from
    the lower left corner; None: all. Raises ValueError if the lens is shifted too far.
    """
    width, height = size
    x0, y0, x1, y1 = border or (0, 0, width, height)
    wide, tall = x1 - x0, y1 - y0
    is_flat = projection[3, 3] != 0
    a, b = (projection[0, 3], projection[1, 3]) if is_flat else (-projection[0, 2], -projection[1, 2])
    view = view_of(place, projection, tall / height, lens)
    # The pixel on the optical axis; the farm's lens shift is in units of the requested height.
    sight = width * (1 + a) / 2, height * (1 + b) / 2
    shifts = {"shift_x": ((x0 + x1) / 2 - sight[0]) / tall, "shift_y": ((y0 + y1) / 2 - sight[1]) / tall}
    if max(map(abs, shifts.values())) > MOST_SHIFT:
        raise ValueError("The lens is shifted further than the farm's are.")
    view |= {name: float(shift) for name, shift in shifts.items() if abs(shift) > LEAST_SHIFT}
    return Shot(view, wide, tall, 0, 0, wide, tall)


def _unit(vector: F64) -> F64:
    return vector / max(float(np.linalg.norm(vector)), 1e-30)
