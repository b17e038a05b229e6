"""Trees over geometry that deforms while the shutter is open, and bounds of moving bodies."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.build import NO_RADIUS, tree_over
from renderer.bvh.curve_ends import segment_ends
from renderer.bvh.layout import CURVES, LEAF_KIND, ROW_CHILD, ROW_PRIMITIVE
from renderer.bvh.motion import ANGLE, PLACE, POINT, STRETCH, TURN
from renderer.threads import Team

__all__ = ["keyed_tree", "motion_boxes"]

Array = npt.NDArray[Any]

_STEP = math.radians(3.0)  # half the rotation between two samples of a box's position
_SLACK = 2.0**-20
_SYMMETRIC = STRETCH + np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


def keyed_tree(
    position: Array, triangle: Array, sphere: Array, first_sphere: int, team: Team, radius: Array = NO_RADIUS
) -> tuple[Array, Array]:
    """Returns the nodes and packets of a tree over vertices that move linearly between K keys. Each packet is stored K times.

    position: (K, V, 3) f32. triangle: (T, 3) i32, rows of a key's positions. sphere: (K, S, 4) f32. Primitives are numbered as in
    `renderer.bvh.build.build`. radius: (V,) f32 of curves, which does not change, or no rows.
    """
    keys = len(sphere)
    node, packet = tree_over(position, triangle, sphere, first_sphere, team, radius)
    number = packet[:, ROW_PRIMITIVE].view(np.int32)
    there = ~np.isnan(packet[:, 0])
    many = np.repeat(packet, keys, axis=0).reshape(len(packet), keys, *packet.shape[1:])
    for k in range(keys):
        solid = there & (number < len(triangle))
        p, lane = np.nonzero(solid)
        corners = position[k][triangle[number[solid]]]  # (n, 3, 3)
        many[p, k, :9, lane] = corners.reshape(-1, 9)
        round_ = there & (number >= first_sphere)
        p, lane = np.nonzero(round_)
        many[p, k, :4, lane] = sphere[k][number[round_] - first_sphere]
    child = node[:, ROW_CHILD].view(np.int32)
    leaves = (child < 0) & (node[:, 0] <= node[:, 1])
    leaf = ~child[leaves]
    if len(curved := leaf[leaf & LEAF_KIND == CURVES] >> 2):
        is_segment = np.flatnonzero((triangle[:, 1] == triangle[:, 2]) & (triangle[:, 0] != triangle[:, 1]))
        row = np.zeros(len(triangle), np.int64)
        row[is_segment] = np.arange(len(is_segment))
        which, lane = np.nonzero(there[curved])
        for k in range(keys):  # in place of third corners
            ends = segment_ends(position[k], triangle[is_segment, :2], radius)
            many[curved[which], k, 6:9, lane] = ends[row[number[curved[which], lane]]]
    child[leaves] = ~((leaf >> 2) * (4 * keys) + (leaf & 3))
    return node, many.reshape(-1, *packet.shape[1:])


def motion_boxes(box: Array, keys: Array) -> Array:
    """Returns the bounds of boxes over the whole motion of a body: lower and upper corner, (2, 3) f64.

    box: (n, 2, 3) f64 in the body's space. keys: (K, KEY_COLUMNS), see motion.py. Between two sampled times a point deviates from
    the straight line by at most the sagitta of its arc, which is added.
    """
    corners = np.array([np.where(which, box[:, 1], box[:, 0]) for which in np.ndindex(2, 2, 2)]).reshape(-1, 3)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for before, after in pairwise(keys):
        y = corners - before[POINT : POINT + 3]
        stretched = np.concatenate([_transform_points(key[_SYMMETRIC], y) for key in (before, after)])
        reach = float(np.sqrt((stretched * stretched).sum(axis=1).max(initial=0.0)))
        turns = _intermediate_rotations(before[TURN : TURN + 4], after[TURN : TURN + 4], float(before[ANGLE]))
        there = []
        for i, turn in enumerate(turns):
            share = i / (len(turns) - 1)
            place = before[PLACE : PLACE + 3] * (1.0 - share) + after[PLACE : PLACE + 3] * share
            there.append(_transform_points(_rotation(turn), stretched) + place)
        sagitta = reach * (1.0 - min(float((turns[0] * turns[1]).sum()), 1.0))
        low = np.minimum(low, np.min(there, axis=(0, 1)) - sagitta)
        high = np.maximum(high, np.max(there, axis=(0, 1)) + sagitta)
    slack = _SLACK * np.maximum(np.maximum(np.abs(low), np.abs(high)), high - low)
    return np.stack([low - slack, high + slack])


def _transform_points(matrix: Array, points: Array) -> Array:
    """Multiplies points, (n, 3), by a matrix given as nine elements. Avoids BLAS, whose last bits depend on the processor."""
    m = np.asarray(matrix).reshape(3, 3)
    x, y, z = points.T
    return np.stack([m[k, 0] * x + m[k, 1] * y + m[k, 2] * z for k in range(3)], axis=1)


def _intermediate_rotations(before: Array, after: Array, half_angle: float) -> list[Array]:
    """Returns quaternions from `before` to `after`, both included, in equal rotation steps of at most twice `_STEP`.

    half_angle: half the rotation angle from `before` to `after`, in radians. Each quaternion between is the normalised sum of its
    neighbours.
    """
    found = [before, after]
    while half_angle > _STEP:
        half_angle *= 0.5
        middles = [a + b for a, b in pairwise(found)]
        middles = [m / math.sqrt(float((m * m).sum())) for m in middles]
        found = [each for pair in zip(found, middles, strict=False) for each in pair] + found[-1:]
    return found


def _rotation(turn: Array) -> Array:
    x, y, z, w = turn
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
