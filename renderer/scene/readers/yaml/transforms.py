"""Transforms of a scene file: lists of operations, applied in the order in which they are written."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.sentences import Sentence
from renderer.trigonometry import sin_cos

__all__ = ["Matrix", "joined", "matrix", "uniform_scale"]

MOST_DEGREES = 1e7  # about 28,000 turns

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def matrix(operations: list[dict[str, Any]], document: Yaml, path: Path) -> Matrix:
    """Returns the 4x4 matrix, for column vectors, of a list of operations. Raises SceneError if an operation is invalid."""
    result = np.eye(4)
    for i, operation in enumerate(operations):
        ((kind, value),) = operation.items()
        step = np.eye(4)
        if kind == "translate":
            step[:3, 3] = value
        elif kind == "scale":
            step[[0, 1, 2], [0, 1, 2]] = value
        elif kind == "matrix":
            step = np.array(value, np.float64)
            if not np.allclose(step[3], (0, 0, 0, 1)):
                raise document.error(
                    (*path, i, "matrix"),
                    Sentence("transform-last-row-wrong", "its last row must be 0 0 0 1"),
                )
        else:
            axis = np.array(_AXES[value["axis"]] if isinstance(value["axis"], str) else value["axis"], np.float64)
            length = math.sqrt(float(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]))
            if length < 1e-12:
                raise document.error((*path, i, "rotate", "axis"), Sentence("direction-zero", "has length 0; give a direction"))
            if abs(value["degrees"]) > MOST_DEGREES:
                raise document.error(
                    (*path, i, "rotate", "degrees"),
                    Sentence(
                        "angle-out-of-range",
                        "is beyond {most}; subtract whole turns",
                        most=f"{MOST_DEGREES:g}",
                    ),
                )
            step[:3, :3] = _rotation(axis / length, math.radians(value["degrees"]))
        result = joined(step, result, document, (*path, i))
    return result


def joined(outer: Matrix, inner: Matrix, document: Yaml, path: Path) -> Matrix:
    """Returns the transform that applies `inner`, then `outer`. Raises SceneError if the product overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        place = product(outer, inner)
    if not np.isfinite(place).all():
        raise document.error(
            path,
            Sentence("transform-overflow", "combined with its parents, its transform is too large for 32-bit numbers"),
        )
    return place


def uniform_scale(transform: Matrix) -> float | None:
    """Returns the uniform scale factor of a transform; None if its scale is not uniform."""
    gram = product(transform[:3, :3].T, transform[:3, :3])
    square = float(np.trace(gram)) / 3
    return float(np.sqrt(square)) if np.allclose(gram, square * np.eye(3), atol=1e-6 * max(square, 1e-30)) else None


def _rotation(axis: Matrix, angle: float) -> Matrix:
    # Rodrigues' formula.
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = sin_cos(angle)
    return np.eye(3) + sine * cross + product((1 - cosine) * cross, cross)
