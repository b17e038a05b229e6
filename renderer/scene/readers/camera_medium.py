"""Sets the world's medium from the medium around the camera."""

from __future__ import annotations

import numpy as np

from renderer.scene.description import Medium, SceneDescription
from renderer.scene.material import Material

__all__ = ["fill_world"]


def fill_world(description: SceneDescription, found: Medium) -> None:
    """Sets the world's medium to the medium around the first camera.

    Does nothing if the camera is inside a shape filled with that medium. found: the medium around the first camera.
    """
    if not any((*found.sigma_a, *found.sigma_s, found.volume)):
        return
    if description.cameras and _is_within(description, found, np.array(description.cameras[0].view.eye, np.float64)):
        return
    description.medium = found


def _is_within(description: SceneDescription, found: Medium, eye: np.ndarray) -> bool:
    """Returns True if the point `eye` is within the bounds of a shape filled with the medium `found`."""
    filled = {number for number, made in enumerate(description.materials) if _is_of(made, found)}
    for sphere in description.spheres:
        if sphere.material in filled and float(np.linalg.norm(eye - np.array(sphere.center))) < sphere.radius:
            return True
    for instance in description.instances:
        mesh = description.meshes[instance.mesh]
        if (mesh.material if instance.material is None else instance.material) not in filled or not len(mesh.positions):
            continue
        try:
            x, y, z = np.linalg.solve(instance.transform, np.array([*eye, 1.0]))[:3]
        except np.linalg.LinAlgError:
            continue
        if (mesh.positions.min(axis=0) < (x, y, z)).all() and ((x, y, z) < mesh.positions.max(axis=0)).all():
            return True
    return False


def _is_of(material: Material, found: Medium) -> bool:
    return Medium(material.sigma_a, material.sigma_s, material.g, material.volume) == found
