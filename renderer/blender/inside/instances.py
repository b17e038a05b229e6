"""Converts instances of collections, particles and geometry nodes to objects that share meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from .point_clouds import MOST_POINTS, mesh_of_points
from .sentences import Sentence, first_items

__all__ = ["LEFT_OUT", "VISIBLE", "MakeHair", "instances_as_objects", "is_left_out"]

MOST_INSTANCES = 200_000
MOST_PLACES = 2_000_000  # of all instances over all frames
KINDS = ("MESH", "CURVE", "SURFACE", "FONT", "META", "LIGHT", "POINTCLOUD")
LEFT_OUT = {
    "POINTCLOUD": Sentence("blend-point-clouds", "Point clouds"),
    "VOLUME": Sentence("blend-volumes", "Volumes"),
    "CURVES": Sentence("blend-hair-curves", "Hair curves"),
    "GPENCIL": Sentence("blend-grease-pencil", "Grease pencil drawings"),
    "GREASEPENCIL": Sentence("blend-grease-pencil", "Grease pencil drawings"),
}
VISIBLE = tuple(f"visible_{kind}" for kind in ("camera", "shadow", "diffuse", "glossy", "transmission", "volume_scatter"))
MakeHair = Callable[[Any, Any], Any]  # an object, and its data: hair curves; returns a mesh, or None
ON_MESHES = ("VERTS", "FACES")
NEAR = 1e-6
SHEARED = 1e-5


class _ShownInstance(NamedTuple):
    """An instance that Blender shows of an object.

    key: identifies the instance at all frames. place: the instance's transform. thing: the instanced object. mesh: the object's
    evaluated mesh.
    """

    key: Any
    parent: Any
    thing: Any
    mesh: Any
    place: Any


def instances_as_objects(
    bpy: Any, scene: Any, visible_names: set[str], frames: list[int], make_hair: MakeHair | None, notes: list[str]
) -> None:
    """Creates an object for each instance at the current frame, and animates it over the other frames.

    visible_names: names of the visible objects; the names of the new objects are added. make_hair: converts hair; None: it is
    left out. notes: receives warnings.
    """
    found = _find_instances(bpy, visible_names, make_hair)
    _note_left_out(bpy, visible_names, make_hair is not None, notes)
    moves = _transforms_over_frames(bpy, scene, visible_names, frames, found, make_hair is not None, notes)
    for each in found:
        thing = bpy.data.objects.new(f"{each.parent.name} instance", each.mesh)
        for flag in VISIBLE:
            setattr(thing, flag, getattr(each.parent, flag) and getattr(each.thing, flag))
        scene.collection.objects.link(thing)
        visible_names.add(thing.name)
        _place_object(bpy, scene, thing, each.place, moves.get(each.key), frames, notes)
    for each in found:
        if each.parent.instance_type in ON_MESHES and each.thing.parent == each.parent:
            visible_names.discard(each.thing.name)  # in renders, unlike in a viewport, it is visible only as an instance
    for owner in sorted({each.parent.name for each in found}):
        thing = scene.objects[owner]
        thing.instance_type = "NONE"
        if thing.type == "MESH" and not (thing.show_instancer_for_render or thing.type == "EMPTY"):
            visible_names.discard(owner)
    bent = sorted({each.thing.name for each in found if _is_bent(each.thing)}) if len(frames) > 1 else []
    if bent:
        notes.append(
            Sentence(
                "blend-instance-deformed",
                "{names}: instances deformed by bones or shape keys are shown as at the first frame",
                names=first_items(bent, 5),
            )
        )
    if len(found) >= MOST_INSTANCES:
        notes.append(Sentence("blend-instance-limit", "Only the first {count} instances are shown", count=f"{MOST_INSTANCES:,}"))


def _find_instances(bpy: Any, visible_names: set[str], make_hair: MakeHair | None) -> list[_ShownInstance]:
    graph = bpy.context.evaluated_depsgraph_get()
    made: dict[Any, Any] = {}  # by evaluated mesh: its copy
    found: list[_ShownInstance] = []
    for instance in graph.object_instances:
        if not _is_exported(instance, visible_names, make_hair is not None) or len(found) >= MOST_INSTANCES:
            continue
        thing, data = instance.object, instance.object.data
        if data not in made:
            is_hair = make_hair is not None and thing.type == "CURVES"
            made[data] = make_hair(thing, data) if make_hair is not None and is_hair else _mesh_of(bpy, thing, data, graph)
        if made[data] is None:
            continue
        found.append(
            _ShownInstance(
                _instance_key(instance), instance.parent.original, thing.original, made[data], instance.matrix_world.copy()
            )
        )
    return found


def _is_exported(instance: Any, visible_names: set[str], has_hair: bool) -> bool:
    if not instance.is_instance or instance.parent is None or instance.parent.original.name not in visible_names:
        return False
    if has_hair and instance.object.type == "CURVES":
        return True
    return instance.object.type in KINDS and instance.object.data is not None and not is_left_out(instance.object)


def is_left_out(thing: Any) -> bool:
    """Returns True if an object is of a kind that is not exported: one of LEFT_OUT, but small point clouds are meshes."""
    return thing.type in LEFT_OUT and not (thing.type == "POINTCLOUD" and 0 < len(thing.data.points) <= MOST_POINTS)


def _note_left_out(bpy: Any, visible_names: set[str], has_hair: bool, notes: list[str]) -> None:
    """Adds notes on instanced objects and results of geometry nodes that are not exported because they are not surfaces."""
    names: dict[str, dict[str, None]] = {}
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if has_hair and instance.object.type == "CURVES":
            continue
        if is_left_out(instance.object) and instance.is_instance and instance.parent is not None:
            owner = instance.parent.original.name
            if owner in visible_names:
                names.setdefault(LEFT_OUT[instance.object.type], {})[owner] = None
    for kinds, owners in names.items():
        notes.append(
            Sentence(
                "blend-instanced-kind-left-out",
                "{kind} that are instances or made by geometry nodes are left out: {names}",
                kind=kinds,
                names=first_items(owners, 5),
            )
        )


def _instance_key(instance: Any) -> Any:
    return instance.parent.original.name, instance.object.original.name, tuple(instance.persistent_id)


def _transforms_over_frames(
    bpy: Any,
    scene: Any,
    visible_names: set[str],
    frames: list[int],
    found: list[_ShownInstance],
    has_hair: bool,
    notes: list[str],
) -> dict[Any, list[Any]]:
    """Returns a dict of instance key -> transforms at all frames, with only the instances that move."""
    if len(frames) < 2 or not found:
        return {}
    if len(frames) * len(found) > MOST_PLACES:
        notes.append(
            Sentence(
                "blend-instance-motion-limit",
                "The {count} instances stand still as at the first frame, since they are too many for {frames} frames",
                count=f"{len(found):,}",
                frames=f"{len(frames):,}",
            )
        )
        return {}
    first = {each.key: each.place for each in found}
    places: dict[Any, list[Any]] = {key: [] for key in first}
    moving, is_other = set(), False
    for frame in frames:
        scene.frame_set(frame)
        seen = 0
        for instance in bpy.context.evaluated_depsgraph_get().object_instances:
            if not _is_exported(instance, visible_names, has_hair):
                continue
            seen += 1
            key = _instance_key(instance)
            if key not in first:
                is_other = True
                continue
            place = instance.matrix_world.copy()
            places[key].append(place)
            if key not in moving and _transforms_differ(place, first[key]):
                moving.add(key)
        is_other = is_other or seen != len(first)
    scene.frame_set(frames[0])
    if is_other:
        notes.append(
            Sentence(
                "blend-instance-set-changes", "The set of instances changes between frames; that of the first frame is shown"
            )
        )
    return {key: places[key] for key in moving if len(places[key]) == len(frames)}


def _transforms_differ(a: Any, b: Any) -> bool:
    return any(abs(x - y) > NEAR * max(1.0, abs(y)) for rows in zip(a, b, strict=True) for x, y in zip(*rows, strict=True))


def _place_object(
    bpy: Any, scene: Any, thing: Any, place: Any, places: list[Any] | None, frames: list[int], notes: list[str]
) -> None:
    """Places an object by one transform, or by one per frame (`places`).

    A sheared object gets a parent with non-uniform scale.
    """
    if _is_unsheared(place):
        carrier, turn = thing, None
    else:
        import numpy as np
        from mathutils import Matrix

        _, _, turned = np.linalg.svd(np.array(place.to_3x3(), np.float64))
        turn = Matrix((turned * (1 if np.linalg.det(turned) > 0 else -1)).tolist())
        carrier = bpy.data.objects.new(f"{thing.name} place", None)
        scene.collection.objects.link(carrier)
        thing.parent, thing.matrix_basis = carrier, turn.to_4x4()
    back = None if turn is None else turn.transposed().to_4x4()
    carrier.matrix_world = place if back is None else place @ back
    if places is None:
        return
    straight = [each if back is None else each @ back for each in places]
    _animate(carrier, straight, frames)
    if not all(_is_unsheared(each) for each in straight):
        notes.append(Sentence("blend-shear-in-motion", "{object}: shear while it moves is left out", object=thing.name))


def _is_unsheared(place: Any) -> bool:
    from mathutils import Matrix

    again = Matrix.LocRotScale(*place.decompose())
    most = max(abs(place[i][k]) for i in range(3) for k in range(3))
    return all(abs(again[i][k] - place[i][k]) <= SHEARED * most for i in range(3) for k in range(3))


def _animate(thing: Any, places: list[Any], frames: list[int]) -> None:
    thing.rotation_mode = "QUATERNION"
    before = None
    for frame, place in zip(frames, places, strict=True):
        at, turn, scale = place.decompose()
        if before is not None:
            turn.make_compatible(before)
        before = turn
        for name, value in (("location", at), ("rotation_quaternion", turn), ("scale", scale)):
            setattr(thing, name, value)
            thing.keyframe_insert(name, frame=frame)


def _is_bent(thing: Any) -> bool:
    keys = getattr(thing.data, "shape_keys", None)
    return any(each.type == "ARMATURE" for each in thing.modifiers) or (keys is not None and keys.animation_data is not None)


def _mesh_of(bpy: Any, thing: Any, data: Any, graph: Any) -> Any:
    """Returns an instance's mesh. For geometry nodes it differs from the object's own mesh, though their names are equal."""
    if thing.type == "LIGHT":
        return thing.original.data
    if thing.type == "POINTCLOUD":
        return mesh_of_points(bpy, thing.name, data)
    if thing.type == "MESH" and data != thing.original.evaluated_get(graph).data:
        return data.copy()
    return bpy.data.meshes.new_from_object(thing, preserve_all_data_layers=True, depsgraph=graph)
