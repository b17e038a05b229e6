"""Decides whether two scene descriptions compile to the same scene."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from renderer.scene.description import SceneDescription

__all__ = ["are_equal", "compiles_alike"]

_IGNORED_FIELDS = {
    "name",
    "cameras",
    "clips",
    "fps",
    "keys",
    "moves",
    "still",
    "up_axis",
    "variants",
    "variation",
    "vary",
    "warnings",
    "defaults",
}  # attributes that affect no array


def compiles_alike(first: SceneDescription, second: SceneDescription) -> bool:
    """Returns True if two descriptions compile to the same scene: equal geometry, materials and lights.

    Cameras and texts may differ. Neither description may have been compiled before.
    """
    return all(
        are_equal(getattr(first, f.name), getattr(second, f.name))
        for f in fields(SceneDescription)
        if f.name not in _IGNORED_FIELDS
    )


def are_equal(a: Any, b: Any) -> bool:
    """Returns True if two values of types used in descriptions are equal, with arrays and nested values compared by content."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(are_equal, a, b))
    if is_dataclass(a):
        return all(are_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)
