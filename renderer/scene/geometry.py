"""All instances' triangles as one list: in the world's space, or once in their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.parts import padded
from renderer.errors import SceneError
from renderer.kernel.mesh.faces import find_corners
from renderer.scene.description import F32, I32, SceneDescription
from renderer.scene.instances import Group, Sharing, share
from renderer.scene.objects import number_objects
from renderer.scene.placed import Placed, placed, with_keys
from renderer.scene.readable import read_only
from renderer.threads import PART, Team, parts_of

__all__ = ["MAX_TRIANGLES", "NOWHERE", "Geometry", "Placement", "bounds_of", "by_triangle", "flatten", "keys_step", "place"]

MAX_TRIANGLES = 20_000_000
NOWHERE = -2
_FEW_KEYS = 5
_MOST_POINTS = 2_000_000  # instances times vertices whose places are looked at one by one
_ROW_BYTES = 4  # of the narrowest array of vertices or triangles: what ends at a page's end there does so in all


class Geometry(NamedTuple):
    """Triangles, as in CompiledScene: the world's that stand still, those of each tree that is kept once, in its own space (first
    of trees that stand still, then of those that move), then the world's that are others at another moment.

    Between these three may be triangles and vertices that are nowhere, so that each begins at a page (renderer/bvh/parts.py).
    """

    position: F32  # (V, 3)
    normal: F32  # (V, 3), unit
    uv: F32  # (V, 2)
    uv1: F32  # (V or 0, 2)
    color: F32  # (V or 0, 4)
    tangent: F32  # (V or 0, 4)
    triangle: I32  # (T, 3)
    first: I32  # (P + 1,) the first triangle of each part, and the number of all triangles
    material: I32  # (P,)
    object: I32  # (P,); -1 in groups, NOWHERE of what fills a page
    keys: F32 = np.zeros((0, 2, 0, 3), np.float32)  # (K or 0, 2, D, 3) positions and normals of the last vertices


def by_triangle(geometry: Geometry, of_part: np.ndarray) -> np.ndarray:
    """(T,) what is known of each part, for each of its triangles."""
    return np.repeat(of_part, np.diff(geometry.first))


class Placement(NamedTuple):
    """Where the groups stand, those that move last."""

    tree: I32  # (G, 2) the triangles of each group: the first, and that behind the last
    still: int  # how many of them stand still
    group: I32  # (I,) of each instance
    to_world: npt.NDArray[np.float64]  # (I, 3, 4)
    material: I32  # (I,) or -1: the triangles' own
    object: I32  # (I,)
    number: list[int]  # (I,) the description's instance that each is
    world: tuple[int, int]  # the triangles of the world are those before the first number, and those from the second on

    @property
    def still_instances(self) -> int:
        """How many instances show groups that stand still: the first."""
        return int(np.count_nonzero(self.group < self.still))


class _Part(NamedTuple):
    """Triangles of one material and object."""

    placed: Placed
    material: int
    object: int


def place(description: SceneDescription, team: Team) -> tuple[Geometry, Placement]:
    """Copies meshes into the world, or keeps them once, as renderer/scene/instances.py decides.

    Raises SceneError where more than MAX_TRIANGLES are left, or a place is beyond the range of float32.
    """
    sharing = share(description)
    _check_size(description, sharing)
    objects = number_objects(description).instance
    groups = sharing.groups + sharing.bodies
    still = [_copy(description, n, objects[n], team) for n in sharing.copied]
    kept = [_group(description, group, team) for group in groups]
    loose = [_copy(description, n, objects[n], team, whole=True) for n in sharing.loose]
    loose = _over_the_shutter(description, sharing.loose, loose, team)
    of_still = [part for group in kept[: len(sharing.groups)] for part in group]
    of_bodies = [part for group in kept[len(sharing.groups) :] for part in group]
    geometry, starts = _joined([still + of_still, of_bodies, loose])
    if loose and len(loose[0].placed.keys):
        geometry = geometry._replace(keys=np.concatenate([part.placed.keys for part in loose], axis=2))
    lengths = [sum(len(part.placed.triangle) for part in group) for group in kept]
    tree = []
    at = _count(still)
    for g, length in enumerate(lengths):
        at = starts[1] if g == len(sharing.groups) else at
        tree.append((at, at + length))
        at += length
    which = [(g, n) for g, group in enumerate(groups) for n in group.instances]
    shown = [description.instances[n] for _, n in which]
    placement = Placement(
        np.array(tree, np.int32).reshape(-1, 2),
        len(sharing.groups),
        np.array([g for g, _ in which], np.int32),
        np.array([np.asarray(i.transform, np.float64)[:3] for i in shown]).reshape(-1, 3, 4),
        np.array([-1 if i.material is None else i.material for i in shown], np.int32),
        np.array([objects[n] for _, n in which], np.int32),
        [n for _, n in which],
        (_count(still), starts[2]),
    )
    return geometry, placement


def flatten(description: SceneDescription) -> Geometry:
    """Copies every instance into the world."""
    objects = number_objects(description).instance
    team = Team(1)
    return _joined([[_copy(description, n, number, team) for n, number in enumerate(objects)]])[0]


def _check_size(description: SceneDescription, sharing: Sharing) -> None:
    meshes = [description.meshes[description.instances[n].mesh] for n in sharing.copied + sharing.loose]
    meshes += [description.meshes[m] for group in sharing.groups + sharing.bodies for m in group.meshes]
    for total, limit, what in (
        (sum(len(m.triangles) for m in meshes), MAX_TRIANGLES, "triangles"),
        (sum(len(m.positions) for m in meshes), 3 * MAX_TRIANGLES, "vertices"),
    ):
        if total > limit:
            raise SceneError(
                f"{description.name}: has {total / 1e6:.0f} million {what}, repeated meshes counted once; at most "
                f"{limit // 10**6} million fit. Simplify its meshes"
            )


def _copy(description: SceneDescription, number: int, object: int, team: Team, whole: bool = False) -> _Part:
    """An instance in the world."""
    instance = description.instances[number]
    mesh = description.meshes[instance.mesh]
    material = mesh.material if instance.material is None else instance.material
    return _Part(placed(description, mesh, instance.transform, [material], team, whole), material, object)


def _over_the_shutter(description: SceneDescription, numbers: list[int], parts: list[_Part], team: Team) -> list[_Part]:
    """What is placed at each moment, with its vertices at the keys of the shutter if any of it moves meanwhile.

    What turns has all keys, since it goes straight from one to the next; what only bends has few.
    """
    shown = [description.instances[n] for n in numbers]
    meshes = [description.meshes[instance.mesh] for instance in shown]
    spheres = any(sphere.keys for sphere in description.spheres)
    if not spheres and not any(instance.keys or mesh.keys for instance, mesh in zip(shown, meshes, strict=True)):
        return parts
    step = keys_step(description)
    found = []
    for part, instance, mesh in zip(parts, shown, meshes, strict=True):
        places = (instance.keys or (instance.transform,) * description.keys)[::step]
        thinned = replace(mesh, keys=mesh.keys[::step])
        found.append(part._replace(placed=with_keys(part.placed, thinned, places, team)))
    return found


def keys_step(description: SceneDescription) -> int:
    """Every how many-th of the shutter's keys is one of what goes straight from key to key."""
    turns = any(instance.keys for instance in description.instances) or any(sphere.keys for sphere in description.spheres)
    few = (description.keys - 1) % (_FEW_KEYS - 1) == 0
    return (description.keys - 1) // (_FEW_KEYS - 1) if few and not turns else 1


def _group(description: SceneDescription, group: Group, team: Team) -> list[_Part]:
    """A group in its own space."""
    parts = []
    own = [description.instances[n].material for n in group.instances]
    for m in group.meshes:
        mesh = description.meshes[m]
        used = sorted({mesh.material if number is None else number for number in own})
        material = mesh.material if mesh.material in used else used[0]
        parts.append(_Part(placed(description, mesh, np.eye(4), used, team), material, -1))
    return parts


def _count(parts: Sequence[_Part]) -> int:
    return sum(len(part.placed.triangle) for part in parts)


def _joined(sections: Sequence[Sequence[_Part]]) -> tuple[Geometry, list[int]]:
    """The parts as one, and the first triangle of each section; sections begin at a page.

    What only some parts have the others get neutral values for; for the second UVs, the first.
    """
    parts = [part for section in sections for part in section]
    triangles, vertices, starts = [0], [0], []
    material, object = [], []
    first: list[tuple[int, int]] = []
    for i, section in enumerate(sections):
        starts.append(triangles[-1])
        for part in section:
            first.append((vertices[-1], triangles[-1]))
            vertices.append(vertices[-1] + len(part.placed.position))
            triangles.append(triangles[-1] + len(part.placed.triangle))
            material.append(part.material)
            object.append(part.object)
        ends = padded(triangles[-1], _ROW_BYTES), padded(vertices[-1], _ROW_BYTES)
        if any(sections[i + 1 :]) and ends != (triangles[-1], vertices[-1]):
            triangles.append(ends[0])
            vertices.append(ends[1])
            material.append(0)
            object.append(NOWHERE)
    if len(parts) == 1 and len(material) == 1:
        only = parts[0].placed
        arrays = (*only[:6], only.triangle)
    else:
        uv = _together([p.placed.uv for p in parts], first, vertices[-1], 2, 0.0)
        uv1 = _together([p.placed.uv1 for p in parts], first, vertices[-1], 2, 0.0)
        for (at, _), part in zip(first, parts, strict=True):
            if len(uv1) and not len(part.placed.uv1):
                uv1[at : at + len(part.placed.uv)] = part.placed.uv
        triangle = np.zeros((triangles[-1], 3), np.int32)
        for (vertex, at), part in zip(first, parts, strict=True):
            np.add(part.placed.triangle, np.int32(vertex), out=triangle[at : at + len(part.placed.triangle)])
        arrays = (
            _together([p.placed.position for p in parts], first, vertices[-1], 3, 0.0),
            _together([p.placed.normal for p in parts], first, vertices[-1], 3, 0.0),
            uv,
            uv1,
            _together([p.placed.color for p in parts], first, vertices[-1], 4, 1.0),
            _together([p.placed.tangent for p in parts], first, vertices[-1], 4, 0.0),
            triangle,
        )
    whole = Geometry(*arrays, np.array(triangles, np.int32), np.array(material, np.int32), np.array(object, np.int32))
    return whole, starts


def _together(arrays: Sequence[F32], first: Sequence[tuple[int, int]], count: int, width: int, neutral: float) -> F32:
    if not any(len(a) for a in arrays):
        return np.zeros((0, width), np.float32)
    whole = np.full((count, width), neutral, np.float32)
    for (at, _), array in zip(first, arrays, strict=True):
        whole[at : at + len(array)] = array
    return whole


def bounds_of(geometry: Geometry, placement: Placement, team: Team) -> list[npt.NDArray[np.float64]]:
    """(n, 3) points in the world whose box holds all triangles: tight, but for what moves, and many instances of large groups."""
    position, triangle = read_only(geometry.position), read_only(geometry.triangle)
    end, again = placement.world
    parts = parts_of(0, end, PART) + parts_of(again, len(triangle), PART)
    points: list[npt.NDArray[np.float64]] = []
    if parts:
        corner = np.empty((len(parts), 2, 3), np.float32)
        team.each(lambda job: find_corners(position, triangle, *job[0], job[1]), zip(parts, corner, strict=True))
        points.append(_corners(corner.reshape(-1, 3)))
    for g, (a, b) in enumerate(placement.tree):
        if a == b:
            continue
        shape = geometry.position[np.unique(geometry.triangle[a:b])].astype(np.float64)
        shown = placement.to_world[placement.group == g]
        if g >= placement.still or len(shape) * len(shown) > _MOST_POINTS:
            low, high = _corners(shape)
            shape = np.array([np.where(which, high, low) for which in np.ndindex(2, 2, 2)])
        x, y, z = shape.T
        for m in shown:  # not by a BLAS, whose last bits depend on the processor
            along = [m[k, 0] * x + m[k, 1] * y + m[k, 2] * z + m[k, 3] for k in range(3)]
            points.append(np.array([[a.min() for a in along], [a.max() for a in along]]))
    return points


def _corners(points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    return np.array([points.min(axis=0), points.max(axis=0)], np.float64)
