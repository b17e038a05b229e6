"""Merges descriptions of a scene at several times while the shutter is open into one with motion keys.

Cameras, instances, mesh vertices, spheres, lights and textures move. Everything else is taken from the middle of the shutter,
with a warning that names the changes that are ignored.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from renderer.bvh.rigid_motion import largest_rotation, motion_keys
from renderer.kernel.camera import axes_of
from renderer.scene.animation import Moment, Shutter
from renderer.scene.description import Camera, Instance, Light, Mesh, SceneDescription, Sphere, UvTransform
from renderer.scene.instances import is_linearly_keyed
from renderer.scene.scene_equality import are_equal
from renderer.scene.texture_motion import merge_moving_textures
from renderer.sentences import Sentence
from renderer.settings import MOST_KEYS

__all__ = ["interpolate_numbered_files", "merge_over_shutter"]

_FIRST_KEYS = 5
_MOST_TURN = math.radians(50.0)  # maximum rotation between keys, so that full turns are recognised
_STRAIGHT_TURN = math.radians(12.0)  # the same for vertices that are interpolated linearly between keys

_Thing = TypeVar("_Thing")


def merge_over_shutter(read: Callable[[Moment], SceneDescription], moment: Moment, shutter: Shutter) -> SceneDescription:
    """Returns the scene in the middle of a frame's shutter, with the keys of moving objects.

    read: returns the scene at a moment, as a new object. If the shutter does not set the number of keys, it is doubled until
    rotations between keys are small. Raises the errors of `read`.
    """
    if shutter.length == 0:
        return read(moment)
    keys = shutter.keys or _FIRST_KEYS
    found = [read(shutter.moment(moment, i / (keys - 1))) for i in range(keys)]
    if not any(each.moves for each in found):
        return found[keys // 2]
    while True:
        middle = found[keys // 2] if keys % 2 else read(shutter.moment(moment, 0.5))
        moving = _merge_as_keys(middle, found)
        if shutter.keys or keys == MOST_KEYS or _has_small_rotations(moving):
            return moving
        keys = 2 * keys - 1
        between = (read(shutter.moment(moment, i / (keys - 1))) for i in range(1, keys, 2))
        found = [each for pair in zip(found, between, strict=False) for each in pair] + found[-1:]


def _merge_as_keys(middle: SceneDescription, found: Sequence[SceneDescription]) -> SceneDescription:
    """Returns the description `middle`, with the states of its objects in the descriptions `found` as their motion keys."""
    middle, found, changes = merge_moving_textures(middle, found)
    instances, meshes, changed = _merge_instances(middle, found)
    cameras = [
        replace(camera, keys=_keys([c.view for c in over], camera.view))
        for camera, over in _match_by_name(middle.cameras, [each.cameras for each in found], _name)
        if not any(c.view.projection != camera.view.projection for c in over)
    ]
    spheres = [
        replace(sphere, keys=_keys([(s.center, s.radius) for s in over], (sphere.center, sphere.radius)))
        for sphere, over in _match_by_name(middle.spheres, [each.spheres for each in found], _name)
    ]
    lights = [
        replace(light, keys=_keys(over, light))
        for light, over in _match_by_name(middle.lights, [each.lights for each in found], lambda light: (light.kind, light.name))
    ]
    moving = replace(middle, instances=instances, meshes=meshes, cameras=cameras, spheres=spheres, lights=lights)
    if any(thing.keys for things in (instances, meshes, spheres, lights, cameras, middle.textures) for thing in things):
        moving.keys = len(found)
    still: list[str] = [name for name, parts in _UNMOVABLE_FIELDS.items() if any(_differs(part, found) for part in parts)]
    still += [Sentence("motion-textures-still", "textures other than their placement")] * changes + changed
    if still:
        moving.warnings.append(_unblurred_warning(still))
    return moving


def interpolate_numbered_files(
    moving: SceneDescription, shutter: Shutter, before: SceneDescription | None, after: SceneDescription | None
) -> None:
    """Adds vertex keys to the meshes of numbered files, interpolated linearly between the previous, this and the next file.

    before, after: the scene at the same time, read from the previous and the next file; None: this frame's file instead.
    """
    here = [(instance, moving.meshes[instance.mesh]) for instance in moving.instances]
    for number, mesh in {instance.mesh: mesh for instance, mesh in here}.items():
        beside = [_mesh_of(number, moving, other) or mesh for other in (before, after)]
        if all(are_equal(other.positions, mesh.positions) for other in beside):
            continue
        if not all(_has_same_topology(mesh, other) for other in beside):
            moving.warnings.append(_unblurred_warning([_changes(mesh)]))
            continue
        moving.keys = moving.keys or shutter.keys or _FIRST_KEYS
        shares = [i / (moving.keys - 1) for i in range(moving.keys)]
        offsets = [shutter.moment(Moment(), share).offset for share in shares]
        keys = [_interpolate_mesh(mesh, beside[0] if offset < 0 else beside[1], min(abs(offset), 1.0)) for offset in offsets]
        moving.meshes[number] = replace(mesh, keys=tuple(keys))


def _mesh_of(number: int, moving: SceneDescription, other: SceneDescription | None) -> Mesh | None:
    """Returns the mesh of the description `other` that corresponds to mesh `number` of the description `moving`.

    Returns None if their numbers of instances differ. Meshes are matched by the order of instances, since names may be derived
    from the file names, which differ.
    """
    if other is None or len(other.instances) != len(moving.instances):
        return None
    places = zip(moving.instances, other.instances, strict=True)
    return next(other.meshes[its.mesh] for instance, its in places if instance.mesh == number)


def _interpolate_mesh(mesh: Mesh, other: Mesh, share: float) -> tuple[np.ndarray, np.ndarray | None]:
    near, part = np.float32(1.0 - share), np.float32(share)
    normals = None
    if mesh.normals is not None and other.normals is not None:
        normals = near * mesh.normals + part * other.normals
    return near * mesh.positions + part * other.positions, normals


def _unblurred_warning(parts: list[str]) -> str:
    return Sentence("motion-not-blurred", "Shown as in the middle of the shutter, not blurred: {parts}.", parts=parts)


def _changes(mesh: Mesh) -> str:
    return Sentence("motion-mesh-triangles-change", "the mesh {name}, whose triangles change", name=mesh.name)


_UNMOVABLE_FIELDS: dict[str, tuple[str, ...]] = {
    Sentence("motion-materials-still", "materials"): ("materials",),
    Sentence("motion-pictures-still", "pictures"): ("images",),
    Sentence("motion-environment-still", "the environment"): ("environment", "medium"),
}


def _differs(part: str, found: Sequence[SceneDescription]) -> bool:
    return any(not are_equal(getattr(each, part), getattr(found[0], part)) for each in found[1:])


def _merge_instances(middle: SceneDescription, found: Sequence[SceneDescription]) -> tuple[list[Instance], list[Mesh], list[str]]:
    """Merges the keys of instances and meshes.

    Returns the instances and the meshes of `middle` with their keys, and a text for each mesh that changes too much to have keys.
    """
    instances, meshes, changed = [], list(middle.meshes), []
    seen: set[int] = set()
    for instance, over in _match_by_name(middle.instances, [each.instances for each in found], lambda i: i.name):
        keys = _keys([i.transform for i in over], instance.transform)
        instances.append(replace(instance, keys=keys, moves=instance.moves or len(keys) > 0))
        if over and instance.mesh not in seen:
            seen.add(instance.mesh)
            mesh = meshes[instance.mesh]
            others = [each.meshes[i.mesh] for each, i in zip(found, over, strict=True)]
            if all(_has_same_topology(mesh, other) for other in others):
                shapes = _keys([(other.positions, other.normals) for other in others], (mesh.positions, mesh.normals))
                meshes[instance.mesh] = replace(mesh, keys=shapes, deforms=mesh.deforms or len(shapes) > 0)
            else:
                changed.append(_changes(mesh))
    return instances, meshes, changed


def _has_same_topology(mesh: Mesh, other: Mesh) -> bool:
    return (
        mesh.positions.shape == other.positions.shape
        and are_equal(mesh.triangles, other.triangles)
        and (mesh.normals is None) == (other.normals is None)
    )


def _keys(values: Sequence[Any], middle: Any) -> tuple[Any, ...]:
    """Returns an object's values at all times as keys; empty if all of them equal the one in the middle."""
    return tuple(values) if any(not are_equal(each, middle) for each in values) else ()


def _match_by_name(
    objects: Sequence[_Thing], others: Sequence[Sequence[_Thing]], name: Callable[[_Thing], Hashable]
) -> list[tuple[_Thing, list[_Thing]]]:
    """Returns each object with its counterparts in the lists `others`, or with none if one of those lists lacks a counterpart.

    Objects are matched by name, and among objects of one name by their order.
    """
    told = _occurrence_keys(objects, name)
    found: list[list[_Thing]] = [[] for _ in objects]
    for other in others:
        names = _occurrence_keys(other, name)
        by_name = dict(zip(names, other, strict=True))
        for at, key in zip(found, told, strict=True):
            if key in by_name:
                at.append(by_name[key])
    return [(thing, at if len(at) == len(others) else []) for thing, at in zip(objects, found, strict=True)]


def _occurrence_keys(objects: Iterable[_Thing], name: Callable[[_Thing], Hashable]) -> list[tuple[Hashable, int]]:
    count: Counter[Hashable] = Counter()
    told = []
    for thing in objects:
        told.append((name(thing), count[name(thing)]))
        count[name(thing)] += 1
    return told


def _name(thing: Sphere | Light | Camera) -> str:
    return thing.name


def _has_small_rotations(moving: SceneDescription) -> bool:
    """Returns True if all rotations between keys are small enough to be unambiguous and interpolated without visible error."""
    free: list[list[np.ndarray]] = []
    straight: list[list[np.ndarray]] = []
    for instance in moving.instances:
        if instance.keys:
            (straight if is_linearly_keyed(moving, instance) else free).append([each[:3] for each in instance.keys])
    straight += [[_as_3d_transform(key) for key in texture.keys] for texture in moving.textures if texture.keys]
    free += [[np.stack(axes_of(view), -1) for view in camera.keys] for camera in moving.cameras if camera.keys]
    return _max_rotation(free) <= _MOST_TURN and _max_rotation(straight) <= _STRAIGHT_TURN


def _as_3d_transform(transform: UvTransform) -> np.ndarray:
    """Returns a 2D texture transform as a 3x4 transform in the xy plane, so that its rotation is one about z."""
    a, b, c, d, e, f = transform
    return np.array([(a, b, 0.0, c), (d, e, 0.0, f), (0.0, 0.0, 1.0, 0.0)])


def _max_rotation(places: list[list[np.ndarray]]) -> float:
    if not places:
        return 0.0
    whole = np.array(places, np.float64)
    sane = np.isfinite(whole).all(axis=(1, 2, 3)) & (np.abs(np.linalg.det(whole[..., :3])) > 0).all(axis=1)
    return largest_rotation(motion_keys(whole[sane])) if sane.any() else 0.0
