"""Finds how the segments of curves are joined, which decides what part of their spherical ends is visible."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["NO_ENDS", "segment_ends"]

Array = npt.NDArray[Any]

NO_ENDS: npt.NDArray[np.float32] = np.zeros((0, 3), np.float32)
NO_ENDS.flags.writeable = False
_SLACK = 1 / 64  # of the radius


def segment_ends(position: Array, segment: Array, radius: Array) -> npt.NDArray[np.float32]:
    """Returns the last numbers (c, 3) of segments in packets: the radii at both points, negative at a loose end, and the reach.

    position: (V, 3). segment: (c, 2) vertices. radius: (V,). The reach, times the radius, bounds the dot product of the axis with
    the points of a sphere at a joint, relative to its centre, that are not inside the next segment: it is the axis' length times
    the sine of the bend, and more where the radius changes.
    """
    if not len(segment):
        return NO_ENDS
    axis = position[segment[:, 1]].astype(np.float64) - position[segment[:, 0]]
    length = np.linalg.norm(axis, axis=1)
    unit = axis / np.maximum(length, 1e-30)[:, None]
    slope = np.abs(np.diff(radius[segment].astype(np.float64), axis=1)[:, 0]) / np.maximum(length, 1e-30)
    base, last = int(segment.min()), int(segment.max())  # a tree's vertices are a small part of all
    following = np.full(last + 1 - base, -1)
    following[segment[:, 0] - base] = np.arange(len(segment))
    following = following[segment[:, 1] - base]
    first = np.flatnonzero((following >= 0) & (following != np.arange(len(segment))))
    second = following[first]
    bend = np.linalg.norm(np.cross(unit[first], unit[second]), axis=1)
    bend = np.where((unit[first] * unit[second]).sum(axis=1) > 0, bend, 1.0) + slope[first] + slope[second] + _SLACK
    reach, loose = np.zeros(len(segment)), np.ones((len(segment), 2), bool)
    np.maximum.at(reach, first, bend)
    np.maximum.at(reach, second, bend)
    loose[first, 1] = loose[second, 0] = False
    found = np.column_stack([radius[segment], reach * length]).astype(np.float32)
    found[:, :2][loose] *= -1
    return found
