"""The upper level of the BVH: trees that are shown somewhere, and what becomes of them in the arrays of the whole."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import ROW_CHILD, ROW_PRIMITIVE

__all__ = ["Instances", "instance_boxes", "inverted", "relocate"]

_INSTANCE_SLACK = 2.0**-20


class Instances(NamedTuple):
    """Where trees are shown. Tree g is over the triangles first[g] ... first[g + 1] - 1, in a space of its own."""

    first: npt.NDArray[Any]  # (G + 1,) ends with the number of all triangles; before first[0] they are the world's own
    tree: npt.NDArray[Any]  # (I,) which tree each instance shows
    to_world: npt.NDArray[Any]  # (I, 3, 4) f64, invertible


def inverted(transform: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """The inverses of (I, 3, 4) transforms: a matrix and, last column, a translation."""
    matrix = np.linalg.inv(transform[:, :, :3])
    return np.concatenate([matrix, -matrix @ transform[:, :, 3:]], axis=2)


def instance_boxes(trees: list[Any], shown: npt.NDArray[Any], to_world: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """(I, 2, 3) lower and upper corners in the world: of each tree's topmost eight boxes, which together fit closer than one."""
    boxes = np.empty((len(shown), 2, 3))
    for number, (node, _) in enumerate(trees):
        lanes = node[0, 0] <= node[0, 1]
        lower, upper = node[0, 0:6:2, lanes].astype(np.float64), node[0, 1:6:2, lanes].astype(np.float64)  # (lanes, 3)
        which = np.flatnonzero(shown == number)
        matrix, offset = to_world[which, :, :3], to_world[which, :, 3]
        if not lanes.any():
            boxes[which] = offset[:, None]
            continue
        center = (lower + upper) / 2 @ matrix.transpose(0, 2, 1) + offset[:, None]
        extent = (upper - lower) / 2 @ np.abs(matrix).transpose(0, 2, 1)
        boxes[which, 0] = (center - extent).min(axis=1)
        boxes[which, 1] = (center + extent).max(axis=1)
    # A ray is rounded once more on its way into the instance's space.
    slack = _INSTANCE_SLACK * np.maximum(np.abs(boxes).max(axis=1), (boxes[:, 1] - boxes[:, 0]))
    boxes[:, 0] -= slack
    boxes[:, 1] += slack
    return boxes


def relocate(node: npt.NDArray[Any], packet: npt.NDArray[Any], first_node: int, first_packet: int, first_primitive: int) -> None:
    """Makes a tree of triangles, built by itself, part of larger arrays."""
    child = node[:, ROW_CHILD].view(np.int32)
    child += np.where(child >= 0, first_node, -4 * first_packet).astype(np.int32)
    number = packet[:, ROW_PRIMITIVE].view(np.int32)
    number += np.where(np.isnan(packet[:, 0]), 0, first_primitive).astype(np.int32)
