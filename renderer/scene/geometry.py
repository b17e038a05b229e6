"""All instances' triangles as one list: in the world's space, or once in their own."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.kernel.mesh.faces import find_corners, find_solid
from renderer.kernel.mesh.vertices import place_normals, place_points
from renderer.scene.description import F32, I32, Mesh, SceneDescription
from renderer.scene.instances import share
from renderer.scene.matrices import product
from renderer.scene.normals import cofactors, face_normals
from renderer.scene.objects import number_objects
from renderer.scene.readable import read_only
from renderer.scene.tangents import needs_tangents, split_mirrored, tangent_uv_set, vertex_tangents
from renderer.threads import PART, Team, parts_of

__all__ = ["MAX_COORDINATE", "MAX_TRIANGLES", "Geometry", "Placement", "bounds_of", "by_triangle", "flatten", "place"]

MAX_TRIANGLES = 20_000_000
_MOST_POINTS = 2_000_000  # instances times vertices whose places are looked at one by one
MAX_COORDINATE = 1e15  # squares and products of it stay within float32


class Geometry(NamedTuple):
    """Triangles, as in CompiledScene: the world's first, then those of each group that is kept once, in its own space."""

    position: F32  # (V, 3)
    normal: F32  # (V, 3), unit
    uv: F32  # (V, 2)
    uv1: F32  # (V or 0, 2)
    color: F32  # (V or 0, 4)
    tangent: F32  # (V or 0, 4)
    triangle: I32  # (T, 3)
    first: I32  # (P + 1,) the first triangle of each part, and the number of all triangles
    material: I32  # (P,)
    object: I32  # (P,); -1 in groups
    dropped: int  # how many had no area


def by_triangle(geometry: Geometry, of_part: np.ndarray) -> np.ndarray:
    """(T,) what is known of each part, for each of its triangles."""
    return np.repeat(of_part, np.diff(geometry.first))


class Placement(NamedTuple):
    """Where the groups stand."""

    first: I32  # (G + 1,) the first triangle of each group, and the number of all triangles
    group: I32  # (I,) of each instance
    to_world: npt.NDArray[np.float64]  # (I, 3, 4)
    material: I32  # (I,) or -1: the triangles' own
    object: I32  # (I,)


def place(description: SceneDescription, team: Team) -> tuple[Geometry, Placement]:
    """Copies meshes into the world, or keeps them once, as renderer/scene/instances.py decides.

    Raises SceneError where more than MAX_TRIANGLES are left, or a place is beyond the range of float32.
    """
    sharing = share(description)
    objects = number_objects(description).instance
    meshes = [description.meshes[description.instances[n].mesh] for n in sharing.copied]
    meshes += [description.meshes[m] for group in sharing.groups for m in group.meshes]
    for total, limit, what in (
        (sum(len(m.triangles) for m in meshes), MAX_TRIANGLES, "triangles"),
        (sum(len(m.positions) for m in meshes), 3 * MAX_TRIANGLES, "vertices"),
    ):
        if total > limit:
            raise SceneError(
                f"{description.name}: has {total / 1e6:.0f} million {what}, repeated meshes counted once; at most "
                f"{limit // 10**6} million fit. Simplify its meshes"
            )
    parts = []
    for n in sharing.copied:
        instance = description.instances[n]
        mesh = description.meshes[instance.mesh]
        material = mesh.material if instance.material is None else instance.material
        parts.append(_placed(description, mesh, instance.transform, material, [material], objects[n], team))
    first = [sum(len(p.triangle) for p in parts)]
    for group in sharing.groups:
        for m in group.meshes:
            mesh = description.meshes[m]
            own = [description.instances[n].material for n in group.instances]
            used = sorted({mesh.material if number is None else number for number in own})
            material = mesh.material if mesh.material in used else used[0]
            parts.append(_placed(description, mesh, np.eye(4), material, used, -1, team))
        first.append(sum(len(p.triangle) for p in parts))
    which = [(g, n) for g, group in enumerate(sharing.groups) for n in group.instances]
    shown = [description.instances[n] for _, n in which]
    placement = Placement(
        np.array(first, np.int32),
        np.array([g for g, _ in which], np.int32),
        np.array([np.asarray(i.transform, np.float64)[:3] for i in shown]).reshape(-1, 3, 4),
        np.array([-1 if i.material is None else i.material for i in shown], np.int32),
        np.array([objects[n] for _, n in which], np.int32),
    )
    return _joined(parts), placement


def flatten(description: SceneDescription) -> Geometry:
    """Copies every instance into the world."""
    objects = number_objects(description).instance
    parts = []
    team = Team(1)
    for instance, number in zip(description.instances, objects, strict=True):
        mesh = description.meshes[instance.mesh]
        material = mesh.material if instance.material is None else instance.material
        parts.append(_placed(description, mesh, instance.transform, material, [material], number, team))
    return _joined(parts)


def _joined(parts: list[Geometry]) -> Geometry:
    """The parts as one. What only some of them have the others get neutral values for; for the second UVs, the first."""
    if len(parts) == 1:
        return parts[0]
    first = np.cumsum([0] + [len(p.position) for p in parts])
    vertices = int(first[-1])

    def together(name: str, width: int, neutral: float) -> F32:
        arrays = [getattr(p, name) for p in parts]
        if not any(len(a) for a in arrays):
            return np.zeros((0, width), np.float32)
        whole = np.full((vertices, width), neutral, np.float32)
        for at, array in zip(first, arrays, strict=False):
            whole[at : at + len(array)] = array
        return whole

    uv, uv1 = together("uv", 2, 0.0), together("uv1", 2, 0.0)
    for at, part in zip(first, parts, strict=False):
        if len(uv1) and not len(part.uv1):
            uv1[at : at + len(part.uv)] = part.uv
    triangles = [np.zeros((0, 3), np.int32)] + [p.triangle + np.int32(f) for p, f in zip(parts, first, strict=False)]
    none = [np.zeros(0, np.int32)]
    count = [len(p.triangle) for p in parts]
    return Geometry(
        together("position", 3, 0.0),
        together("normal", 3, 0.0),
        uv,
        uv1,
        together("color", 4, 1.0),
        together("tangent", 4, 0.0),
        np.concatenate(triangles),
        np.cumsum([0, *count], dtype=np.int32),
        np.concatenate(none + [p.material for p in parts]),
        np.concatenate(none + [p.object for p in parts]),
        sum(p.dropped for p in parts),
    )


def _placed(
    description: SceneDescription,
    mesh: Mesh,
    transform: npt.NDArray[np.float64],
    material: int,
    materials: list[int],
    number: int,
    team: Team,
) -> Geometry:
    """A mesh of one material and object; materials: all that instances may give it, which decides on its tangents."""
    transform = np.ascontiguousarray(transform, np.float64)
    position = _placed_points(mesh, transform, team)
    triangle = read_only(mesh.triangles.astype(np.int32, copy=False))
    mirrors = bool(np.linalg.det(transform[:3, :3]) < 0)
    if mirrors:
        triangle = read_only(triangle[:, [0, 2, 1]])
    solid = np.empty(len(triangle), bool)
    with_area = team.each(lambda part: find_solid(position, triangle, *part, solid), parts_of(0, len(triangle), PART))
    dropped = len(triangle) - sum(with_area)
    if dropped:
        triangle = np.ascontiguousarray(triangle[solid])
    # Each vertex's number in the mesh: the attributes follow wherever vertices are split.
    vertex: slice | npt.NDArray[np.int64] = slice(None)
    if mesh.normals is None:  # flat: no vertex is shared, each has its face's normal
        face = face_normals(position, triangle)
        vertex = triangle.reshape(-1).astype(np.int64)
        normal = np.repeat((face / np.linalg.norm(face, axis=1)[:, None]).astype(np.float32), 3, axis=0)
        triangle = np.arange(len(vertex), dtype=np.int32).reshape(-1, 3)
    else:
        normal = _placed_normals(mesh.normals, transform, position, triangle, team)
    tangent = np.zeros((0, 4), np.float32)
    bent = [description.materials[m] for m in materials if needs_tangents(description.materials[m])]
    if bent and mesh.tangents is not None and mesh.normals is not None:
        tangent = _carried_tangents(mesh.tangents, transform, mirrors)
    elif bent:
        uvs = mesh.uvs1 if tangent_uv_set(description, bent[0]) else mesh.uvs
        uv = _finite(uvs, len(mesh.positions), 2)[vertex]
        kept, triangle = split_mirrored(uv, triangle)
        vertex, normal = np.arange(len(position))[vertex][kept], normal[kept]
        tangent = vertex_tangents(position[vertex], normal, uv[kept], triangle)
    none = np.zeros((0, 4), np.float32)
    return Geometry(
        position[vertex],
        normal,
        _finite(mesh.uvs, len(mesh.positions), 2)[vertex],
        none[:, :2] if mesh.uvs1 is None else _finite(mesh.uvs1, len(mesh.positions), 2)[vertex],
        none if mesh.colors is None else np.clip(_finite(mesh.colors, len(mesh.positions), 4), 0, 1)[vertex],
        tangent,
        triangle,
        np.array([0, len(triangle)], np.int32),
        np.array([material], np.int32),
        np.array([number], np.int32),
        dropped,
    )


def bounds_of(geometry: Geometry, placement: Placement, team: Team) -> list[npt.NDArray[np.float64]]:
    """(n, 3) points in the world whose box holds all triangles: tight, but for many instances of large groups."""
    position, triangle = read_only(geometry.position), read_only(geometry.triangle)
    parts = parts_of(0, int(placement.first[0]), PART)
    points: list[npt.NDArray[np.float64]] = []
    if parts:
        corner = np.empty((len(parts), 2, 3), np.float32)
        team.each(lambda job: find_corners(position, triangle, *job[0], job[1]), zip(parts, corner, strict=True))
        points.append(_corners(corner.reshape(-1, 3)))
    for g, (a, b) in enumerate(pairwise(placement.first)):
        if a == b:
            continue
        shape = geometry.position[np.unique(geometry.triangle[a:b])].astype(np.float64)
        shown = placement.to_world[placement.group == g]
        if len(shape) * len(shown) > _MOST_POINTS:
            low, high = _corners(shape)
            shape = np.array([np.where(which, high, low) for which in np.ndindex(2, 2, 2)])
        places = shape @ shown[:, :, :3].transpose(0, 2, 1) + shown[:, None, :, 3]
        points.append(_corners(places.reshape(-1, 3)))
    return points


def _corners(points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    return np.array([points.min(axis=0), points.max(axis=0)], np.float64)


def _finite(values: np.ndarray | None, count: int, width: int) -> F32:
    """(count, width) float32: zeros where there are no values, and for those that are no numbers."""
    if values is None:
        return np.zeros((count, width), np.float32)
    if not np.isfinite(values).all():
        values = np.where(np.isfinite(values), values, 0)
    return np.asarray(values, np.float32)


def _placed_points(mesh: Mesh, transform: npt.NDArray[np.float64], team: Team) -> F32:
    """The mesh's positions in the world."""
    point = read_only(mesh.positions.astype(np.float32, copy=False))
    placed = np.empty((len(point), 3), np.float32)
    largest = team.each(lambda part: place_points(point, transform, *part, placed), parts_of(0, len(point), PART))
    if not all(each <= MAX_COORDINATE for each in largest):
        raise SceneError(f"Mesh {mesh.name}: its place in the world is beyond what numbers hold; give it a sane transform")
    return read_only(placed)


def _placed_normals(normals: F32, transform: npt.NDArray[np.float64], position: F32, triangle: I32, team: Team) -> F32:
    """A mesh's normals in the world, unit. Files do hold zero normals: the faces around the vertex stand in."""
    own, matrix = read_only(normals.astype(np.float32, copy=False)), np.ascontiguousarray(cofactors(transform))
    placed, length = np.empty((len(own), 3), np.float32), np.empty(len(own))
    team.each(lambda part: place_normals(own, matrix, *part, placed, length), parts_of(0, len(own), PART))
    most = float(np.max(length, initial=0, where=np.isfinite(length)))
    bad = np.flatnonzero(~(np.isfinite(length) & (length > 1e-12 * max(most, 1e-300))))
    if len(bad):
        around = np.zeros((len(own), 3))
        face = face_normals(position, triangle)
        for k in range(3):
            np.add.at(around, triangle[:, k], face)
        around = around[bad]
        size = np.linalg.norm(around, axis=1, keepdims=True)
        placed[bad] = np.divide(around, size, out=np.tile([0.0, 1.0, 0.0], (len(bad), 1)), where=size > 0)
    return placed


def _carried_tangents(tangents: F32, transform: np.ndarray, mirrors: bool) -> F32:
    """A file's tangents in the world. Mirrored, the frame changes hands: the normal keeps its side, the tangent turns."""
    direction = product(_finite(tangents, len(tangents), 4)[:, None, :3].astype(np.float64), transform[:3, :3].T)[:, 0]
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = np.divide(direction, length, out=np.tile([[1.0, 0.0, 0.0]], (len(direction), 1)), where=length > 0)
    sign = np.where((tangents[:, 3] < 0) != mirrors, -1.0, 1.0)
    return np.column_stack([unit, sign]).astype(np.float32)
