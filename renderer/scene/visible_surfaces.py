"""Notes for users about scenes that show nothing from any side: no surface has an area, or all are transparent or hidden."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from renderer.scene.curve_meshes import has_curves
from renderer.scene.description import I32, Instance, Material, SceneDescription
from renderer.sentences import Sentence

__all__ = ["INVISIBLE", "all_hidden_note", "invisible_note"]

_FLAT = 1e-6  # ratio of a triangle's height to its longest edge up to which it counts as a line, since corners are rounded
_CHUNK = 4096  # triangles that are examined at a time
_MOST_TRIANGLES = 4_000_000  # examined in all placed meshes; a scene with more counts as visible. About a second
_PLACEMENT = 256  # triangles that take as long as a placement itself

INVISIBLE = ("scene-without-area", "scene-without-area-at-frame", "scene-invisible")  # codes of invisible_note's sentences

F64 = npt.NDArray[np.float64]


def invisible_note(description: SceneDescription) -> Sentence | None:
    """Returns a sentence for users if the scene, without the studio's floor, shows nothing at its moment; else None.

    Curves, spheres and participating media count as visible, and a scene with too many triangles to be examined. A scene without
    any surface is refused elsewhere.
    """
    instances = description.instances[: len(description.instances) - (description.subject is not None)]
    if description.medium is not None or description.volumes or not (instances or description.spheres):
        return None
    if not (description.spheres or _any_with_area(description, instances)):
        if any(_may_gain_area(description, instance) for instance in instances):
            return Sentence(
                "scene-without-area-at-frame",
                "Nothing is visible at this frame, since no surface has an area. Choose another frame.",
            )
        return Sentence(
            "scene-without-area",
            "Nothing is visible, since no surface of the file has an area: all triangles are points or lines. "
            "Export it with meshes that have one.",
        )
    if description.materials and all(_is_invisible(description.materials[n]) for n in _materials(description, instances)):
        return Sentence(
            "scene-invisible",
            "Nothing is visible, since all surfaces have an opacity of 0 or are hidden from the camera. "
            "Raise the opacity of their materials, or show them.",
        )
    return None


def all_hidden_note(count: int) -> Sentence:
    """Returns the warning of a reader that has left out all meshes of a file, since the file hides them."""
    return Sentence("meshes-hidden", "All of its meshes are hidden ({count}); show them before you export it.", count=count)


def _any_with_area(description: SceneDescription, instances: list[Instance]) -> bool:
    left = _MOST_TRIANGLES
    for instance in instances:
        mesh = description.meshes[instance.mesh]
        triangles = mesh.triangles[:left]
        if has_curves(mesh) or has_area(mesh.positions, triangles, np.asarray(instance.transform, np.float64)):
            return True
        left -= len(triangles) + _PLACEMENT
        if left <= 0:
            return True
    return False


def _may_gain_area(description: SceneDescription, instance: Instance) -> bool:
    """Returns True if an instance without an area may have one at another frame."""
    mesh = description.meshes[instance.mesh]
    return mesh.deforms or (instance.moves and has_area(mesh.positions, mesh.triangles, np.eye(4)))


def has_area(positions: npt.NDArray[np.floating], triangles: I32, transform: F64) -> bool:
    """Returns True if a triangle, of corners transformed by a 4x4 matrix, is more than a point or a line."""
    for first in range(0, len(triangles), _CHUNK):
        corners = positions[triangles[first : first + _CHUNK]].astype(np.float64) @ transform[:3, :3].T
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        longest = np.max([np.linalg.norm(edge, axis=1) for edge in (b - a, c - b, a - c)], axis=0)
        twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        if (twice_area > _FLAT * longest**2).any():
            return True
    return False


def _materials(description: SceneDescription, instances: list[Instance]) -> Iterator[int]:
    yield from (sphere.material for sphere in description.spheres)
    for instance in instances:
        yield description.meshes[instance.mesh].material if instance.material is None else instance.material


def _is_invisible(material: Material) -> bool:
    """Returns True if a surface with this material is invisible to the camera for all values of its textures."""
    if material.unseen:
        return True
    is_clear = {"opaque": False, "mask": material.opacity < material.alpha_cutoff, "blend": material.opacity <= 0.0}
    return material.kind != "interface" and is_clear[material.alpha_mode] and not any(material.emission)
