"""Bounds of a scene description."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import SceneDescription

__all__ = ["bounds_of"]


def bounds_of(description: SceneDescription) -> npt.NDArray[np.float64]:
    """Returns the world-space bounds (2, 3) of all triangles and spheres. The description must have at least one."""
    points = [np.zeros((0, 3))]
    for each in description.instances:
        mesh = description.meshes[each.mesh]
        if len(mesh.triangles):
            used = mesh.positions[np.unique(mesh.triangles)] @ each.transform[:3, :3].T + each.transform[:3, 3]
            points += [used.min(axis=0)[None], used.max(axis=0)[None]]
    points += [np.array([ball.center]) + sign * ball.radius for ball in description.spheres for sign in (-1, 1)]
    whole = np.concatenate(points)
    return np.stack([whole.min(axis=0), whole.max(axis=0)])
