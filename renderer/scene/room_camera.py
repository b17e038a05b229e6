"""Default camera of a room: stands inside, since from outside only the backs of its walls are seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh, SceneDescription
from renderer.settings import Vec3, View

__all__ = ["room_view"]

F64 = npt.NDArray[np.float64]

_FOV = 60.0  # degrees, vertical
_BAND = 0.02  # thickness of a wall, relative to the room
_COVERED = 0.5  # least fraction of the floor, and of each of three walls, that faces into the room
_WALLS = 3
_OUT = 0.4  # from the middle of the room towards a corner, relative to the room
_EYE, _TARGET = 0.1, -0.15  # above the middle, relative to the room's height
_CLEAR = 0.12  # distance of the eye from the nearest vertex, relative to the room's shorter side
_CORNERS = ((1, 1), (-1, 1), (1, -1), (-1, -1))  # of x and z; the first as the usual default camera has it


def room_view(description: SceneDescription, bounds: F64) -> View | None:
    """Returns a view from a corner of a room with Y up; None if the scene is no room.

    The scene is a room if its floor and at least three walls lie on the sides of its bounding box, face inwards, and something
    stands between them. bounds: (2, 3) corners of the scene. The page does the same (web/js/mesh/room.js).
    """
    low, high = np.asarray(bounds, np.float64)
    extent = high - low
    if not (extent > 0).all() or description.up[1] < 0.9:
        return None
    facing, inside = np.zeros((2, 3)), list[tuple[F64, npt.NDArray[np.int32], npt.NDArray[np.bool_]]]()
    shown = description.instances if description.subject is None else description.instances[:-1]  # without the studio's floor
    for each in shown:
        mesh, place = description.meshes[each.mesh], np.asarray(each.transform, np.float64)
        positions = mesh.positions.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
        is_near = np.stack([positions - low < _BAND * extent, high - positions < _BAND * extent])  # (2, V, 3)
        outer = np.flatnonzero(is_near.any(axis=(0, 2))[mesh.triangles].all(axis=1))
        at_side = is_near[:, mesh.triangles[outer]].all(axis=2)  # (2, n, 3): whether a triangle lies on a side
        normal = _fronts(mesh, positions, place, outer)
        facing[0] += np.where(at_side[0], normal, 0.0).sum(axis=0)
        facing[1] -= np.where(at_side[1], normal, 0.0).sum(axis=0)
        rest = np.ones(len(mesh.triangles), np.bool_)
        rest[outer[at_side.any(axis=(0, 2))]] = False
        inside.append((positions, mesh.triangles, rest))
    areas = extent.prod() / extent
    walls = facing / areas
    if walls[0, 1] < _COVERED or (walls[:, [0, 2]] >= _COVERED).sum() < _WALLS:
        return None
    points = np.concatenate([positions[np.unique(triangles[rest])] for positions, triangles, rest in inside])
    if not len(points):
        return None
    middle = (low + high) / 2
    eyes = [middle + extent * (_OUT * x, _EYE, _OUT * z) for x, z in _CORNERS]
    clear = [float(np.linalg.norm(points - eye, axis=1).min()) for eye in eyes]
    enough = _CLEAR * min(extent[0], extent[2])
    chosen = next((i for i, free in enumerate(clear) if free >= enough), int(np.argmax(clear)))
    return View(_vec3(eyes[chosen]), _vec3(middle + extent * (0.0, _TARGET, 0.0)), (0.0, 1.0, 0.0), _FOV)


def _fronts(mesh: Mesh, positions: F64, place: F64, chosen: npt.NDArray[np.intp]) -> F64:
    """Returns the (n, 3) normals of the chosen triangles' front sides in world space, whose lengths are their areas.

    A front is where a mesh's normals point; without normals, its corners are counterclockwise there.
    """
    triangles = mesh.triangles[chosen]
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a) / 2 * np.sign(np.linalg.det(place[:3, :3]))
    if mesh.normals is not None:
        a, b, c = (mesh.positions[triangles[:, k]].astype(np.float64) for k in range(3))
        agree = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[triangles].sum(axis=1))
        normal[agree < 0] *= -1
    return normal


def _vec3(v: F64) -> Vec3:
    return float(v[0]), float(v[1]), float(v[2])
