"""glTF transforms as 4x4 matrices for column vectors (specification 3.5.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from renderer.scene.description import Vec3
from renderer.scene.matrices import Matrix
from renderer.scene.readers.gltf.container import Json

__all__ = ["Matrix", "compose", "local", "unit_vector", "vec3"]

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NOWHERE, _UNTURNED, _AS_IT_IS = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0)


def local(nodes: Sequence[Json]) -> Matrix:
    """Returns (N, 4, 4) transforms of nodes relative to their parents, vectorised since files have tens of thousands of nodes."""
    parts = np.tile(np.array([*_NOWHERE, *_UNTURNED, *_AS_IT_IS]), (len(nodes), 1))
    whole = {}
    for i, node in enumerate(nodes):
        if "matrix" in node:
            whole[i] = np.array(node.vector("matrix", _IDENTITY)).reshape(4, 4).T  # column-major
            continue
        if "translation" in node:
            parts[i, :3] = node.vector("translation", _NOWHERE)
        if "rotation" in node:
            parts[i, 3:7] = node.vector("rotation", _UNTURNED)
        if "scale" in node:
            parts[i, 7:] = node.vector("scale", _AS_IT_IS)
    found = compose(parts[:, :3], parts[:, 3:7], parts[:, 7:])
    for i, matrix in whole.items():
        found[i] = matrix
    return found


def compose(translation: Matrix, rotation: Matrix, scale: Matrix) -> Matrix:
    """Returns (N, 4, 4) matrices T * R * S.

    translation: (N, 3); rotation: (N, 4) quaternions x y z w of any length; scale: (N, 3).
    """
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    turned = np.divide(rotation, length, out=np.tile(np.array([0.0, 0, 0, 1]), (len(rotation), 1)), where=length > 1e-12)
    x, y, z, w = turned.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result = np.tile(np.eye(4), (len(rotation), 1, 1))
    result[:, :3, :3] = np.moveaxis(np.array(rows), 2, 0) * scale[:, None, :]
    result[:, :3, 3] = translation
    return result


def unit_vector(v: Matrix) -> Matrix:
    """Returns the vector scaled to length 1; the zero vector is unchanged."""
    return v / max(float(np.linalg.norm(v)), 1e-300)


def vec3(v: Matrix) -> Vec3:
    """Returns the first three numbers as floats."""
    return float(v[0]), float(v[1]), float(v[2])
