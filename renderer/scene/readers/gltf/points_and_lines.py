"""Converts points and lines of glTF to small spheres and thin tubes (specification 3.7.2.1)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Mesh
from renderer.scene.readers.points import MOST_POINTS, sphere_mesh
from renderer.scene.readers.tubes import tubes

__all__ = ["mesh_of_points_or_lines"]

_POINTS, _PAIRS, _LOOP, _STRIP = 0, 1, 2, 3
_SIDES = 8


def mesh_of_points_or_lines(
    name: str, positions: F32, indices: npt.NDArray[np.integer], mode: int, colors: F32 | None, thickness: float
) -> Mesh | None:
    """Returns a mesh of points or lines, `thickness` wide; None if it has no triangles. Very many points are subsampled.

    mode: the primitive's mode in glTF; colors: (V, 4) linear RGBA, or None.
    """
    radius = thickness / 2
    if mode == _POINTS:
        chosen = indices[:: -(-len(indices) // MOST_POINTS) or 1]
        if not len(chosen):
            return None
        mesh, _ = sphere_mesh(name, positions[chosen], None, radius)
        if colors is not None:
            mesh.colors = np.repeat(colors[chosen], len(mesh.positions) // len(chosen), axis=0)
        return mesh
    if mode == _PAIRS:
        pairs = indices[: len(indices) // 2 * 2].reshape(-1, 2)
    else:
        closed = np.r_[indices, indices[:1]] if mode == _LOOP and len(indices) > 2 else indices
        pairs = np.stack([closed[:-1], closed[1:]], axis=1)
    ends = positions[pairs].astype(np.float64)
    long = (ends[:, 0] != ends[:, 1]).any(axis=1)
    pairs, ends = pairs[long][:MOST_POINTS], ends[long][:MOST_POINTS]
    if not len(pairs):
        return None
    shown = None if colors is None else colors[pairs].astype(np.float64)
    points, normals, tints, triangles, *_ = tubes(ends, np.full(pairs.shape, radius), shown, _SIDES)
    mesh = Mesh(name, points.astype(np.float32), triangles.astype(np.int32), normals.astype(np.float32))
    mesh.colors = None if tints is None else tints.astype(np.float32)
    return mesh
