"""The upper level of the BVH: instances of trees, and copying of separately built trees into shared arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import ROW_CHILD, ROW_PRIMITIVE
from renderer.bvh.transforms import place_boxes

__all__ = ["Instances", "instance_boxes", "relocate", "root_boxes"]

_INSTANCE_SLACK = 2.0**-20


class Instances(NamedTuple):
    """Instances of trees. Tree g contains the triangles first[g] ... first[g + 1] - 1, in its own space."""

    first: npt.NDArray[Any]  # (G + 1,) ends with the number of all triangles; triangles before first[0] are the world's own
    tree: npt.NDArray[Any]  # (I,) the tree of each instance
    to_world: npt.NDArray[Any]  # (I, 3, 4) f64, invertible


def instance_boxes(trees: list[Any], shown: npt.NDArray[Any], to_world: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Returns the world-space bounds of instances, (I, 2, 3).

    Computed from the topmost eight boxes of each tree, which together are tighter than one box.
    """
    boxes = [root_boxes(node) for node, _ in trees]
    first = np.cumsum([0, *map(len, boxes)])
    placed = np.empty((len(shown), 2, 3))
    # The ray is rounded once more on its transform into instance space: hence the slack.
    place_boxes(
        np.concatenate([np.zeros((0, 2, 3)), *boxes]),
        first.astype(np.int64),
        np.asarray(shown).astype(np.int64),
        np.ascontiguousarray(to_world, np.float64).reshape(-1, 3, 4),
        _INSTANCE_SLACK,
        placed,
    )
    return placed


def root_boxes(node: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Returns the lower and upper corners of a tree's topmost boxes, (n, 2, 3) f64."""
    if not len(node):
        return np.zeros((0, 2, 3))
    lanes = node[0, 0] <= node[0, 1]
    return np.stack([node[0, 0:6:2, lanes], node[0, 1:6:2, lanes]], axis=1).astype(np.float64)


def relocate(node: npt.NDArray[Any], packet: npt.NDArray[Any], first_node: int, first_packet: int, first_primitive: int) -> None:
    """Offsets the indices stored in a separately built triangle tree, in place, for copying the tree into larger arrays.

    first_node, first_packet, first_primitive: the numbers that the tree's first node, packet and primitive get in them.
    """
    child = node[:, ROW_CHILD].view(np.int32)
    child += np.where(child >= 0, first_node, -4 * first_packet).astype(np.int32)
    number = packet[:, ROW_PRIMITIVE].view(np.int32)
    number += np.where(np.isnan(packet[:, 0]), 0, first_primitive).astype(np.int32)
