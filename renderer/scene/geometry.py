"""Collects the triangles of all instances in one list, in world space or in the space of a shared BVH."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.kernel.mesh.faces import find_corners
from renderer.scene.back_to_back_faces import separate_coincident
from renderer.scene.description import F32, I32, SceneDescription
from renderer.scene.instances import Group, Sharing, is_linearly_keyed
from renderer.scene.kernel_arguments import read_only
from renderer.scene.mesh_batch import MOST_VERTICES, placed_together
from renderer.scene.object_ids import number_objects
from renderer.scene.placed_mesh import Placed, placed, with_keys
from renderer.scene.tangents import needs_tangents
from renderer.sentences import Sentence
from renderer.threads import PART, Team, parts_of

__all__ = [
    "MAX_TRIANGLES",
    "MIN_BATCH_INSTANCES",
    "NO_PLACEMENT",
    "Geometry",
    "Placement",
    "Section",
    "build_bodies",
    "build_per_frame",
    "build_static",
    "by_triangle",
    "check_size",
    "flatten",
    "keys_step",
    "moving_corners",
    "placement_of",
    "still_corners",
]

MAX_TRIANGLES = 20_000_000
NO_PLACEMENT = -2
MIN_BATCH_INSTANCES = 8  # number of small instances that is worth a batch
_FEW_KEYS = 5
_MOST_POINTS = 2_000_000  # instances times vertices up to which vertices are transformed for the bounds, instead of boxes

F64 = npt.NDArray[np.float64]


class Geometry(NamedTuple):
    """Triangles in three sections, as in CompiledScene: static ones in world space, those of shared BVHs, and per-frame ones.

    Those of shared BVHs are stored once, in the BVH's own space: first the BVHs of static instances, then those of moving ones.
    Each section starts at a page boundary, so padding triangles and vertices may be in between (renderer/bvh/subtrees.py).
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
    object: I32  # (P,); -1 in groups, NOWHERE for padding
    keys: F32 = np.zeros((0, 2, 0, 3), np.float32)  # (K or 0, 2, D, 3) positions and normals of the last vertices


def by_triangle(geometry: Geometry, of_part: np.ndarray) -> np.ndarray:
    """Returns a value for each triangle, (T,): that of the part to which the triangle belongs.

    of_part: the parts' values, (P,).
    """
    return np.repeat(of_part, np.diff(geometry.first))


class Placement(NamedTuple):
    """The placed instances of all meshes that are stored once: the group of meshes, transform, material and object of each.

    Static instances come first.
    """

    group: I32  # (I,) of each instance
    still: int  # number of static instances
    to_world: F64  # (I, 3, 4)
    material: I32  # (I,) or -1: the triangles' own
    object: I32  # (I,)
    number: list[int]  # (I,) the index of the description's instance


class _Part(NamedTuple):
    """Consecutive triangles that were placed by one call, with the material, object and number of triangles of each mesh."""

    placed: Placed
    material: list[int]
    object: list[int]
    length: list[int]  # triangles of each


class Section(NamedTuple):
    """Separately built geometry with its own triangle numbers: first the world-space triangles, then those of each shared BVH."""

    geometry: Geometry
    world: int  # the number of world parts
    trees: tuple[tuple[int, int], ...]  # the triangles of each tree
    corners: tuple[F64, ...]  # (n, 3) points that bound the world-space triangles, then those of each tree in its own space


def build_static(description: SceneDescription, sharing: Sharing, objects: Sequence[int], team: Team) -> Section:
    """Builds the section of static geometry. Raises SceneError if a position exceeds the range of float32."""
    world = _place_copies(description, sharing.copied, objects, team)
    return _section(world, [_group_parts(description, group, team) for group in sharing.groups], team, apart=True)


def build_bodies(description: SceneDescription, sharing: Sharing, team: Team) -> Section:
    """Builds the section of rigid moving bodies."""
    return _section([], [_group_parts(description, group, team) for group in sharing.bodies], team, apart=True)


def build_per_frame(description: SceneDescription, sharing: Sharing, objects: Sequence[int], team: Team) -> Section:
    """Builds the section of geometry that is placed in world space again for each frame.

    It has keys if any of it moves while the shutter is open.
    """
    parts = [_world_space_copy(description, n, objects[n], team, whole=True) for n in sharing.loose]
    parts = _add_shutter_keys(description, sharing.loose, parts, team)
    section = _section(parts, [], team)
    if parts and len(parts[0].placed.keys):
        keys = np.concatenate([part.placed.keys for part in parts], axis=2)
        section = section._replace(geometry=section.geometry._replace(keys=keys))
    return section


def _section(world: list[_Part], trees: list[list[_Part]], team: Team, apart: bool = False) -> Section:
    """Builds a section from world-space parts and the parts of shared BVHs (trees).

    apart: whether coincident faces back to back are separated."""
    geometry = _concatenated(world + [part for tree in trees for part in tree])
    ends = np.cumsum([_count_triangles(world), *(map(_count_triangles, trees))]).tolist()
    if apart:
        material, looks = by_triangle(geometry, geometry.material), (geometry.color, geometry.uv, geometry.uv1)
        apart_ones = separate_coincident(geometry.position, geometry.triangle, material, looks, [end for end in ends[:-1] if end])
        geometry = geometry._replace(position=apart_ones)
    position, triangle = read_only(geometry.position), read_only(geometry.triangle)
    corners = [_corners_of(position, triangle, a, b, team) for a, b in pairwise([0, *ends])]
    return Section(geometry, ends[0], tuple(pairwise(ends)), tuple(corners))


def _corners_of(position: F32, triangle: I32, first: int, end: int, team: Team) -> F64:
    """Returns the minimum and maximum coordinates, (2, 3), of the triangles `first` to `end` - 1; (0, 3) if there are none."""
    parts = parts_of(first, end, PART)
    corner = np.empty((len(parts), 2, 3), np.float32)
    team.each(lambda job: find_corners(position, triangle, *job[0], job[1]), zip(parts, corner, strict=True))
    return np.array([corner[:, 0].min(axis=0), corner[:, 1].max(axis=0)], np.float64) if parts else np.zeros((0, 3))


def placement_of(description: SceneDescription, sharing: Sharing, objects: Sequence[int]) -> Placement:
    """Returns the placements of all groups of meshes that are stored once, static ones first."""
    groups = sharing.groups + sharing.bodies
    which = [(g, n) for g, group in enumerate(groups) for n in group.instances]
    shown = [description.instances[n] for _, n in which]
    return Placement(
        np.array([g for g, _ in which], np.int32),
        sum(len(group.instances) for group in sharing.groups),
        np.array([np.asarray(i.transform, np.float64)[:3] for i in shown]).reshape(-1, 3, 4),
        np.array([-1 if i.material is None else i.material for i in shown], np.int32),
        np.array([objects[n] for _, n in which], np.int32),
        [n for _, n in which],
    )


def flatten(description: SceneDescription) -> Geometry:
    """Returns the description's geometry with every instance copied into world space."""
    objects = number_objects(description).instance
    team = Team(1)
    return _concatenated([_world_space_copy(description, n, number, team) for n, number in enumerate(objects)])


def check_size(description: SceneDescription, sharing: Sharing) -> None:
    """Raises SceneError if the scene has more than MAX_TRIANGLES triangles; those of an instanced mesh count once."""
    meshes = [description.meshes[description.instances[n].mesh] for n in sharing.copied + sharing.loose]
    meshes += [description.meshes[m] for group in sharing.groups + sharing.bodies for m in group.meshes]
    triangles, vertices = sum(len(m.triangles) for m in meshes), sum(len(m.positions) for m in meshes)
    if triangles > MAX_TRIANGLES:
        raise SceneError(
            Sentence(
                "scene-mesh-triangles-too-many",
                "{name} has {million} million triangles, repeated meshes counted once; at most {most} million are "
                "possible. Simplify its meshes",
                name=description.name,
                million=f"{triangles / 1e6:.0f}",
                most=MAX_TRIANGLES // 10**6,
            )
        )
    if vertices > 3 * MAX_TRIANGLES:
        raise SceneError(
            Sentence(
                "scene-mesh-vertices-too-many",
                "{name} has {million} million vertices, repeated meshes counted once; at most {most} million are "
                "possible. Simplify its meshes",
                name=description.name,
                million=f"{vertices / 1e6:.0f}",
                most=3 * MAX_TRIANGLES // 10**6,
            )
        )


def _world_space_copy(description: SceneDescription, number: int, object: int, team: Team, whole: bool = False) -> _Part:
    """Returns the triangles of one instance, transformed into world space.

    number: index of the instance. object: its object number. whole: keeps triangles without area.
    """
    instance = description.instances[number]
    mesh = description.meshes[instance.mesh]
    material = mesh.material if instance.material is None else instance.material
    return _as_part(placed(description, mesh, instance.transform, [material], team, whole), material, object)


def _as_part(found: Placed, material: int, object: int) -> _Part:
    return _Part(found, [material], [object], [len(found.triangle)])


def _place_copies(description: SceneDescription, numbers: Sequence[int], objects: Sequence[int], team: Team) -> list[_Part]:
    """Returns the triangles of the instances `numbers`, transformed into world space.

    Consecutive small instances are transformed in one batch.
    """
    found: list[_Part] = []
    for is_small, run in groupby(numbers, lambda n: _is_small(description, n)):
        some = list(run)
        part = _copy_small_instances(description, some, objects) if is_small and len(some) >= MIN_BATCH_INSTANCES else None
        found += [part] if part is not None else [_world_space_copy(description, n, objects[n], team) for n in some]
    return found


def _is_small(description: SceneDescription, number: int) -> bool:
    """Returns True if an instance is small enough to be placed in a batch by `placed_together`."""
    instance = description.instances[number]
    mesh = description.meshes[instance.mesh]
    material = description.materials[mesh.material if instance.material is None else instance.material]
    count = len(mesh.positions)
    return 0 < count <= MOST_VERTICES and mesh.normals is not None and len(mesh.triangles) > 0 and not needs_tangents(material)


def _copy_small_instances(description: SceneDescription, numbers: list[int], objects: Sequence[int]) -> _Part | None:
    shown = [description.instances[n] for n in numbers]
    meshes = [description.meshes[instance.mesh] for instance in shown]
    found = placed_together(meshes, [instance.transform for instance in shown])
    if found is None:
        return None
    own = [m.material if i.material is None else i.material for i, m in zip(shown, meshes, strict=True)]
    return _Part(found[0], own, [objects[n] for n in numbers], found[1].tolist())


def _add_shutter_keys(description: SceneDescription, numbers: list[int], parts: list[_Part], team: Team) -> list[_Part]:
    """Adds the vertices at the shutter's keys to the parts, if anything placed per frame moves while the shutter is open.

    Otherwise returns the parts unchanged. Rotating geometry uses all keys, since vertices move linearly between keys; geometry
    that only deforms uses few.
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
    """Returns the step n of the shutter keys at which vertices are stored: every n-th key, with linear interpolation between."""
    straight = any(is_linearly_keyed(description, instance) for instance in description.instances)
    turns = straight or any(sphere.keys for sphere in description.spheres)
    few = (description.keys - 1) % (_FEW_KEYS - 1) == 0
    return (description.keys - 1) // (_FEW_KEYS - 1) if few and not turns else 1


def _group_parts(description: SceneDescription, group: Group, team: Team) -> list[_Part]:
    """Returns the parts of a group of meshes that share one BVH, one part per mesh, in the group's own space."""
    parts = []
    own = [description.instances[n].material for n in group.instances]
    for m in group.meshes:
        mesh = description.meshes[m]
        used = sorted({mesh.material if number is None else number for number in own})
        material = mesh.material if mesh.material in used else used[0]
        parts.append(_as_part(placed(description, mesh, np.eye(4), used, team), material, -1))
    return parts


def _count_triangles(parts: Sequence[_Part]) -> int:
    return sum(len(part.placed.triangle) for part in parts)


def _concatenated(parts: Sequence[_Part]) -> Geometry:
    """Concatenates parts into one geometry.

    Attributes that some parts lack get neutral values; missing second UVs are copied from the first.
    """
    parting = (
        np.cumsum([0, *(length for part in parts for length in part.length)], dtype=np.int32),
        np.array([material for part in parts for material in part.material], np.int32),
        np.array([object for part in parts for object in part.object], np.int32),
    )
    if len(parts) == 1:
        only = parts[0].placed
        return Geometry(*only[:6], only.triangle, *parting)
    first = np.cumsum([0] + [len(part.placed.position) for part in parts])

    def concatenate(name: str, width: int, neutral: float) -> F32:
        arrays = [getattr(part.placed, name) for part in parts]
        if not any(len(a) for a in arrays):
            return np.zeros((0, width), np.float32)
        whole = np.full((int(first[-1]), width), neutral, np.float32)
        for at, array in zip(first, arrays, strict=False):
            whole[at : at + len(array)] = array
        return whole

    uv, uv1 = concatenate("uv", 2, 0.0), concatenate("uv1", 2, 0.0)
    for at, part in zip(first, parts, strict=False):
        if len(uv1) and not len(part.placed.uv1):
            uv1[at : at + len(part.placed.uv)] = part.placed.uv
    triangles = [np.zeros((0, 3), np.int32)]
    triangles += [part.placed.triangle + np.int32(at) for part, at in zip(parts, first, strict=False)]
    return Geometry(
        concatenate("position", 3, 0.0),
        concatenate("normal", 3, 0.0),
        uv,
        uv1,
        concatenate("color", 4, 1.0),
        concatenate("tangent", 4, 0.0),
        np.concatenate(triangles),
        *parting,
    )


def still_corners(still: Section, placement: Placement) -> list[F64]:
    """Returns world-space points whose bounding box contains all static geometry: arrays (n, 3).

    The box is tight, except for groups of many vertices and instances: for those, the group's transformed bounding box is used.
    """
    points = [still.corners[0]]
    for g, (a, b) in enumerate(still.trees):
        shown = placement.to_world[: placement.still][placement.group[: placement.still] == g]
        shape = still.geometry.position[np.unique(still.geometry.triangle[a:b])].astype(np.float64)
        points += _transformed_bounds(
            _box_corners(still.corners[1 + g]) if len(shape) * len(shown) > _MOST_POINTS else shape, shown
        )
    return [p for p in points if len(p)]


def moving_corners(still: Section, bodies: Section, loose: Section, placement: Placement) -> list[F64]:
    """Returns world-space points whose bounding box contains all moving geometry: arrays (n, 3).

    For rigid bodies, their transformed bounding boxes are used.
    """
    points = [loose.corners[0]]
    for g in range(len(bodies.trees)):
        shown = placement.to_world[placement.still :][placement.group[placement.still :] == g + len(still.trees)]
        points += _transformed_bounds(_box_corners(bodies.corners[1 + g]), shown)
    return [p for p in points if len(p)]


def _box_corners(corners: F64) -> F64:
    """Returns the eight corners (8, 3) of the box between two points (2, 3); (0, 3) if empty."""
    return np.array([np.where(which, corners[1], corners[0]) for which in np.ndindex(2, 2, 2)]) if len(corners) else corners


def _transformed_bounds(shape: F64, points: F64) -> list[F64]:
    """Returns the joint bounds, (2, 3), of the points `shape` under all the transforms `points`.

    Returns an empty list without points or transforms. Computed without BLAS, whose last bits depend on the processor.
    """
    if not len(shape) or not len(points):
        return []
    low, high = [], []
    for k in range(3):
        m = points[:, k, :, None]
        along = m[:, 0] * shape[:, 0] + m[:, 1] * shape[:, 1] + m[:, 2] * shape[:, 2] + m[:, 3]
        low.append(along.min())
        high.append(along.max())
    return [np.array([low, high])]
