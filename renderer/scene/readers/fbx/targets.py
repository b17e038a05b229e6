"""Orients FBX cameras and lights to their target node, which replaces their own rotation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import each, matrix, pointed, struct_at, text

__all__ = ["aimed"]

F64 = npt.NDArray[np.float64]
# Nodes that point within 0.5 degrees of the target retain their rotation, and so their roll.
_MIN_COSINE = math.cos(math.radians(0.5))


def aimed(node: Any, scene: Any, world: F64, along: F64) -> F64:
    """Returns a node's world transform, rotated so that the axis `along` points at the node's target node.

    A node without a target keeps its transform. Cameras, whose axis is +X, remain upright.
    """
    target = _target(node, scene)
    if target is None:
        return world
    towards = target - world[:3, 3]
    now = world[:3, :3] @ along
    lengths = float(np.linalg.norm(towards)), float(np.linalg.norm(now))
    if not all(math.isfinite(length) and length > 0 for length in lengths):
        return world
    towards, now = towards / lengths[0], now / lengths[1]
    if now @ towards > _MIN_COSINE:
        return world
    turned = world.copy()
    side = np.cross(towards, (0.0, 1.0, 0.0))
    if along[0] > 0 and np.linalg.norm(side) > 1e-6:
        side /= np.linalg.norm(side)
        turned[:3, :3] = np.column_stack([towards, np.cross(side, towards), side])
    else:
        turned[:3, :3] = _rotation_between(now, towards) @ world[:3, :3]
    return turned


def _target(node: Any, scene: Any) -> F64 | None:
    for link in each(node.connections_dst, layout.Connection):
        if text(link.dst_prop) == "LookAtProperty" and (source := struct_at(layout.Element, link.src)) is not None:
            for other in pointed(scene.nodes, layout.Node):
                if other.element_id == source.element_id:
                    return matrix(other.node_to_world)[:3, 3]
    return None


def _rotation_between(a: F64, b: F64) -> F64:
    """Returns the (3, 3) shortest rotation from unit direction `a` to `b`."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-9:
        other = np.eye(3)[int(np.argmin(np.abs(a)))]
        half = np.cross(a, other) / np.linalg.norm(np.cross(a, other))
        return np.asarray(2 * np.outer(half, half) - np.eye(3))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))
