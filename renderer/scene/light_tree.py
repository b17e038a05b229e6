"""Builds the light tree that renderer/kernel/light/light_tree.py samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.arrays.light_rows import LIGHT_ROWS, LIGHT_WIDTH
from renderer.kernel.light.light_tree_build import build
from renderer.scene.description import F32

__all__ = ["LightBounds", "LightTree", "build_light_tree"]


class LightBounds(NamedTuple):
    """The bounds of L lights, from which the light tree is built: positions, emission directions and intensity of each."""

    center: np.ndarray  # (L, 3); of a distant light, its axis
    radius: np.ndarray  # (L,) of a bounding sphere; -1: infinitely far
    axis: np.ndarray  # (L, 3) unit: normals or emission directions
    spread: np.ndarray  # (L,) radians, maximum angle between the normals and the axis
    reach: np.ndarray  # (L,) radians, maximum angle between emitted light and the normals
    intensity: np.ndarray  # (L,) radiant intensity along the axis, luminance; of a distant light, irradiance
    both: np.ndarray  # (L,) 1 if it emits to both sides


class LightTree(NamedTuple):
    """The nodes of the light tree, and the order in which the lights must be stored."""

    order: np.ndarray  # (L,) int64: the light that becomes number i
    node: F32  # (Y, LIGHT_ROWS, 8): renderer/arrays/light_rows.py


def build_light_tree(bounds: LightBounds) -> LightTree:
    """Builds the light tree over one or more lights; in its order of lights, the distant ones come first."""
    distant = bounds.radius < 0
    order = np.argsort(~distant, kind="stable").astype(np.int64)
    node = np.zeros((max(len(order) - 1, 1), LIGHT_ROWS, LIGHT_WIDTH), np.float32)
    arrays = (np.ascontiguousarray(array, np.float32) for array in bounds)
    used = build(*arrays, int(distant.sum()), order, node)
    return LightTree(order, node[:used])
