"""Bounds of a scene description."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Instance, SceneDescription, Sphere

__all__ = ["bounds_of", "instance_boxes", "sphere_boxes"]

_ROUNDING = 1e-9  # relative, of boxes


def bounds_of(description: SceneDescription) -> npt.NDArray[np.float64]:
    """Returns the world-space bounds (2, 3) of all triangles and spheres. The description must have at least one."""
    points = [np.zeros((0, 3))]
    for each in description.instances:
        mesh = description.meshes[each.mesh]
        if len(mesh.triangles):
            used = mesh.positions[np.unique(mesh.triangles)] @ each.transform[:3, :3].T + each.transform[:3, 3]
            points += [used.min(axis=0)[None], used.max(axis=0)[None]]
    points.append(sphere_boxes(description.spheres).reshape(-1, 3))
    whole = np.concatenate(points)
    return np.stack([whole.min(axis=0), whole.max(axis=0)])


def instance_boxes(description: SceneDescription, placed: list[Instance]) -> npt.NDArray[np.float64]:
    """Returns boxes in world space that contain the instances: (n, 2, 3). They may be larger than needed."""
    if not placed:
        return np.zeros((0, 2, 3))
    used = sorted({each.mesh for each in placed})
    ends = np.array([[description.meshes[i].positions.min(axis=0), description.meshes[i].positions.max(axis=0)] for i in used])
    which = np.searchsorted(used, [each.mesh for each in placed])
    middles, halves = ends.mean(axis=1, dtype=np.float64)[which], (np.ptp(ends, axis=1) / 2)[which]
    places = np.array([each.transform for each in placed], np.float64)
    centres = np.einsum("nij,nj->ni", places[:, :3, :3], middles) + places[:, :3, 3]
    reach = np.einsum("nij,nj->ni", np.abs(places[:, :3, :3]), halves) * (1.0 + _ROUNDING) + _ROUNDING * np.abs(centres)
    return np.stack([centres - reach, centres + reach], axis=1)


def sphere_boxes(spheres: list[Sphere]) -> npt.NDArray[np.float64]:
    """Returns the bounding boxes of spheres: (n, 2, 3)."""
    found = np.array([(*each.center, each.radius) for each in spheres], np.float64).reshape(-1, 4)
    return np.stack([found[:, :3] - found[:, 3:], found[:, :3] + found[:, 3:]], axis=1)
