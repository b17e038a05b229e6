"""Default camera of a room: stands inside, since from outside only the backs of its walls are seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.bounds import instance_boxes
from renderer.scene.description import Instance, Mesh, SceneDescription
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
_MOST_EXAMINED = 5_000_000  # vertices and triangles, at the sides and again near the eyes: 1 to 2 s
_CORNERS = ((1, 1), (-1, 1), (1, -1), (-1, -1))  # of x and z; the first as the usual default camera has it


def room_view(description: SceneDescription, bounds: F64) -> View | None:
    """Returns a view from a corner of a room with Y up; None if the scene is no room.

    The scene is a room if its floor and at least three walls lie on the sides of its bounding box, face inwards, and something
    stands between them. Scenes with very many triangles at the sides are not examined: they are no rooms. bounds: (2, 3), of the
    scene. The page does the same (web/js/mesh/room.js).
    """
    low, high = np.asarray(bounds, np.float64)
    extent = high - low
    if not (extent > 0).all() or description.up[1] < 0.9:
        return None
    shown = description.instances if description.subject is None else description.instances[:-1]  # without the studio's floor
    placed = [each for each in shown if len(description.meshes[each.mesh].triangles)]
    boxes = instance_boxes(description, placed)
    is_outer = (boxes[:, 0] - low < _BAND * extent) | (high - boxes[:, 1] < _BAND * extent)
    outer = [each for each, is_at_side in zip(placed, is_outer.any(axis=1), strict=True) if is_at_side]
    if sum(_size(description.meshes[each.mesh]) for each in outer) > _MOST_EXAMINED:
        return None
    facing = np.zeros((2, 3))
    for each in outer:
        mesh, place = description.meshes[each.mesh], np.asarray(each.transform, np.float64)
        positions, chosen, at_side = _at_sides(mesh, place, low, high)
        normal = _fronts(mesh, positions, place, chosen)
        facing[0] += np.where(at_side[0], normal, 0.0).sum(axis=0)
        facing[1] -= np.where(at_side[1], normal, 0.0).sum(axis=0)
    areas = extent.prod() / extent
    walls = facing / areas
    if walls[0, 1] < _COVERED or (walls[:, [0, 2]] >= _COVERED).sum() < _WALLS:
        return None
    middle = (low + high) / 2
    eyes = np.array([middle + extent * (_OUT * x, _EYE, _OUT * z) for x, z in _CORNERS])
    enough = _CLEAR * min(extent[0], extent[2])
    clear = _clearances(description, placed, boxes, eyes, low, high, enough)
    if not np.isfinite(clear).all():
        return None
    chosen_eye = next((i for i, free in enumerate(clear) if free >= enough), int(np.argmax(clear)))
    return View(_vec3(eyes[chosen_eye]), _vec3(middle + extent * (0.0, _TARGET, 0.0)), (0.0, 1.0, 0.0), _FOV)


def _size(mesh: Mesh) -> int:
    return len(mesh.positions) + len(mesh.triangles)


def _at_sides(mesh: Mesh, place: F64, low: F64, high: F64) -> tuple[F64, npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Returns a mesh's positions in world space, triangles near the sides of a box, and whether each is at a side: (2, n, 3)."""
    positions = mesh.positions.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
    band = _BAND * (high - low)
    is_near = np.stack([positions - low < band, high - positions < band])  # (2, V, 3)
    chosen = np.flatnonzero(np.asarray(is_near.any(axis=(0, 2)))[mesh.triangles].all(axis=1))
    return positions, chosen, np.asarray(is_near[:, mesh.triangles[chosen]].all(axis=2))


def _clearances(
    description: SceneDescription, placed: list[Instance], boxes: F64, eyes: F64, low: F64, high: F64, enough: float
) -> F64:
    """Returns each eye's distance to the nearest vertex of what is not at the sides of the box; infinite if there is none.

    Distances above `enough` may be too large. Examines the objects whose boxes are nearest first, and not more than
    _MOST_EXAMINED vertices and triangles.
    """
    outside = np.maximum(np.maximum(boxes[:, None, 0] - eyes, eyes - boxes[:, None, 1]), 0.0)  # (n, eyes, 3)
    away = np.linalg.norm(outside, axis=2)
    clear, examined = np.full(len(eyes), np.inf), 0
    for number in np.argsort(away.min(axis=1), kind="stable"):
        if np.isfinite(clear).all() and (away[number] >= np.minimum(clear, enough)).all():
            continue
        mesh = description.meshes[placed[number].mesh]
        examined += _size(mesh)
        if examined > _MOST_EXAMINED:
            break
        positions, chosen, at_side = _at_sides(mesh, np.asarray(placed[number].transform, np.float64), low, high)
        is_inside = np.ones(len(mesh.triangles), np.bool_)
        is_inside[chosen[at_side.any(axis=(0, 2))]] = False
        used = np.zeros(len(positions), np.bool_)
        used[mesh.triangles[is_inside]] = True
        if used.any():
            points = positions[used]
            clear = np.minimum(clear, [np.linalg.norm(points - eye, axis=1).min() for eye in eyes])
    return clear


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
