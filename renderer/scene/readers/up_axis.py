"""Rotates files to Y up, and guesses the up axis of files that do not state it.

OBJ, PLY, STL and OFF files state no up axis. By convention STL has Z up and the others Y. A model contradicts the convention if
it stands on the other axis: it has a flat bottom at the origin's height there, and none along the conventional axis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.formats import Format
from renderer.scene.bounds import bounds_of
from renderer.scene.description import SceneDescription
from renderer.sentences import Sentence
from renderer.settings import Vec3

__all__ = ["ROTATIONS", "X_UP", "Z_UP", "guess_up", "turn_up"]

F64 = npt.NDArray[np.float64]

X_UP = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_HALF_TURN = np.diag([1.0, -1, -1, 1])  # about X: the opposite axis is up

# Rotations by which an axis becomes Y.
ROTATIONS = {
    "y": np.eye(4),
    "z": Z_UP,
    "x": X_UP,
    "-y": _HALF_TURN,
    "-z": _HALF_TURN @ Z_UP,
    "-x": _HALF_TURN @ X_UP,
}

_LEVEL = 0.01  # thickness of a bottom, relative to the model's height
_LEVEL_NORMAL = 0.95  # cosine between a bottom's normal, of either side, and the up axis
_STANDS = 0.3  # minimum fraction of the footprint's box that the bottom of a standing model covers
_HANGS = 0.1  # maximum fraction covered if the model does not stand on that axis
_GROUNDED = 0.05  # distance of a bottom from the origin's height, relative to the model's height


def turn_up(file: str, format: Format, up_axis: str | None, description: SceneDescription, guesses: bool = True) -> None:
    """Rotates the content of a file that states no up axis to Y up, and sets the description's `up_axis`.

    up_axis: a key of ROTATIONS. None means the description's `up_axis`, if the reader has set the conventional axis of the file's
    content; else the format's conventional axis or, with `guesses`, the axis on which the model stands, with a warning. Raises
    SceneError if the axis is unknown or the format states its own.
    """
    if up_axis is not None and up_axis not in ROTATIONS:
        raise SceneError(
            Sentence("up-axis-unknown", "up: {up} is no axis; give one of {axes}", up=repr(up_axis[:20]), axes=[*ROTATIONS])
        )
    if not format.up:
        if up_axis is not None:
            raise SceneError(
                Sentence(
                    "file-with-up-axis",
                    "{file}: {format} files state which axis is up; leave the up axis out",
                    file=file,
                    format=format.suffix,
                )
            )
        return
    up = up_axis or description.up_axis or format.up
    if up_axis is None and description.up_axis is None and guesses and (found := guess_up(description, format.up)) != format.up:
        up = found
        description.warnings.append(
            Sentence(
                "up-axis-guessed",
                "{file} states no up axis; {up} is taken, since the model stands on it, instead of {custom}. Choose the up axis "
                "to change that.",
                file=file,
                up=up.upper(),
                custom=format.up.upper(),
            )
        )
    description.up_axis = up
    rotation = ROTATIONS[up] @ ROTATIONS[format.up].T
    if not np.array_equal(rotation, np.eye(4)):
        description.instances = [replace(each, transform=rotation @ each.transform) for each in description.instances]
        description.spheres = [replace(each, center=_vec3(rotation[:3, :3] @ each.center)) for each in description.spheres]


def guess_up(description: SceneDescription, custom: str) -> str:
    """Returns the axis, "y" or "z", on which the model stands; the conventional axis `custom` if it stands on neither or both."""
    other = {"y": "z", "z": "y"}[custom]
    in_file = ROTATIONS[custom][:3, :3]  # multiplied from the right: the inverse rotation
    low, high = np.sort(bounds_of(description) @ in_file, axis=0)
    extent = high - low
    a, b = "xyz".index(other), "xyz".index(custom)
    is_grounded = abs(low[a]) < _GROUNDED * extent[a]
    is_through = low[b] < -_GROUNDED * extent[b] and high[b] > _GROUNDED * extent[b]
    if not (is_grounded and is_through and (extent > 0).all()):
        return custom
    corners = _corners(description) @ in_file
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    middle = corners.mean(axis=1)

    def bottom(axis: int) -> float:
        """Returns the area of the lowest horizontal triangles as a fraction of the model's bounding rectangle in their plane."""
        lowest = middle[:, axis] - low[axis] < _LEVEL * extent[axis]
        level = np.abs(normal[:, axis]) > _LEVEL_NORMAL * area
        return float(0.5 * area[lowest & level].sum() / np.delete(extent, axis).prod())

    return other if bottom(a) > _STANDS and bottom(b) < _HANGS else custom


def _corners(description: SceneDescription) -> F64:
    """Returns the (T, 3, 3) corners of all triangles, in world space."""
    found = [np.zeros((0, 3, 3))]
    for each in description.instances:
        mesh, place = description.meshes[each.mesh], each.transform
        found.append((mesh.positions @ place[:3, :3].T + place[:3, 3])[mesh.triangles])
    return np.concatenate(found)


def _vec3(v: F64) -> Vec3:
    return float(v[0]), float(v[1]), float(v[2])
