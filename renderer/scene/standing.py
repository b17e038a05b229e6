"""Bounding box of what stands on a wide, flat floor: the default camera frames it without the rest of the floor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.bounds import instance_boxes, sphere_boxes
from renderer.scene.description import SceneDescription

__all__ = ["standing_box", "within_footprint"]

F64 = npt.NDArray[np.float64]

_FLAT = 0.02  # height of a floor, relative to its shorter side
_SUNK = 0.05  # depth by which things may be below a floor's top, relative to their height
_WIDER = 4.0  # least area of the floor, relative to that of the things' bounding box
_LONGER = 1.2  # the same of each side, and of its longest to their longest, or their height
_MARGIN = 1e-5  # of a footprint, relative to its longest side: points are rounded


def standing_box(description: SceneDescription) -> F64 | None:
    """Returns the bounding box (2, 3) of all that stands on a floor of the file; None if there is no such floor.

    A floor is every flat object below all objects that are not flat, if the floors together are much wider than all other
    objects. So a terrain, the ground in a room and a table top remain in the picture whole. The floor of the studio, which is
    added to the file, does not count. The page applies the same rule (web/js/mesh/standing.js).
    """
    shown = description.instances if description.subject is None else description.instances[:-1]
    placed = [each for each in shown if len(description.meshes[each.mesh].triangles)]
    boxes = np.concatenate([instance_boxes(description, placed), sphere_boxes(description.spheres)])
    up, across = _axes(description)
    size = boxes[:, 1] - boxes[:, 0]
    is_floor = size[:, up] <= _FLAT * size[:, across].min(axis=1)
    if not is_floor.any() or is_floor.all():
        return None
    low, high = boxes[~is_floor, 0].min(axis=0), boxes[~is_floor, 1].max(axis=0)
    is_floor &= boxes[:, 1, up] <= low[up] + _SUNK * (high[up] - low[up])
    if not is_floor.any():
        return None
    low, high = boxes[~is_floor, 0].min(axis=0), boxes[~is_floor, 1].max(axis=0)
    floor = (boxes[is_floor, 1].max(axis=0) - boxes[is_floor, 0].min(axis=0))[across]
    sides = (high - low)[across]
    is_wide = (floor >= _LONGER * sides).all() and floor.max() >= _LONGER * (high - low).max()
    if not is_wide or floor.prod() < _WIDER * sides.prod():
        return None
    return np.array([low, high])


def within_footprint(description: SceneDescription, points: F64, box: F64) -> F64:
    """Returns the points, of (N, 3), that are above, in or below a box (2, 3)."""
    _, across = _axes(description)
    margin = _MARGIN * (box[1] - box[0]).max()
    inside = (points[:, across] >= box[0, across] - margin) & (points[:, across] <= box[1, across] + margin)
    return points[inside.all(axis=1)]


def _axes(description: SceneDescription) -> tuple[int, list[int]]:
    """Returns the vertical axis of a scene, and the others."""
    up = 2 if abs(description.up[2]) >= 0.9 else 1
    return up, [axis for axis in range(3) if axis != up]
