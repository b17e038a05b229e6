"""The scene as it is rendered, in objects that the glTF exporter knows: modifiers and instances become meshes."""

from __future__ import annotations

from typing import Any

__all__ = ["prepare"]

MOST_INSTANCES = 200_000
VISIBLE = tuple(f"visible_{kind}" for kind in ("camera", "shadow", "diffuse", "glossy", "transmission"))


def prepare(bpy: Any, scene: Any, notes: list[str]) -> list[Any]:
    """Makes the open scene so, at its present frame. Returns the objects that are shown."""
    _as_rendered(scene)
    bpy.context.view_layer.update()
    shown = _shown(bpy, scene)
    _instances(bpy, scene, shown, notes)
    _modifiers(bpy, scene, shown, notes)
    for thing in scene.objects:
        thing.hide_render = thing.name not in shown and thing.type not in ("EMPTY", "ARMATURE")
    return [thing for thing in scene.objects if thing.name in shown]


def _as_rendered(scene: Any) -> None:
    """What the viewport shows is what the exporter sees."""
    for thing in scene.objects:
        for modifier in thing.modifiers:
            modifier.show_viewport = modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                modifier.levels = modifier.render_levels
        if thing.type in ("CURVE", "SURFACE", "FONT") and thing.data.render_resolution_u:
            thing.data.resolution_u = thing.data.render_resolution_u
        for system in getattr(thing, "particle_systems", ()):
            system.settings.display_percentage = 100


def _shown(bpy: Any, scene: Any) -> set[str]:
    """The names of the objects that are rendered: not hidden, nor all their collections, nor left out of the layer."""
    layer = set(bpy.context.view_layer.objects.keys())
    hidden = {collection.name for collection in [*scene.collection.children_recursive] if collection.hide_render}

    def is_hidden(thing: Any) -> bool:
        homes = list(thing.users_collection)
        return bool(homes) and all(_is_within(home, hidden, scene) for home in homes)

    return {thing.name for thing in scene.objects if not thing.hide_render and thing.name in layer and not is_hidden(thing)}


def _is_within(collection: Any, hidden: set[str], scene: Any) -> bool:
    """Whether a collection or one that it lies in is hidden."""
    if collection.name in hidden:
        return True
    parents = [each for each in scene.collection.children_recursive if collection.name in each.children]
    return bool(parents) and all(_is_within(parent, hidden, scene) for parent in parents)


def _instances(bpy: Any, scene: Any, shown: set[str], notes: list[str]) -> None:
    """What modifiers, particles and instancers put into the scene becomes objects, which share their meshes."""
    graph = bpy.context.evaluated_depsgraph_get()
    made: dict[Any, Any] = {}  # of a mesh that a modifier made, by the evaluated one
    found: list[tuple[Any, Any, Any, Any]] = []
    for instance in graph.object_instances:
        if not instance.is_instance or instance.parent is None or instance.parent.original.name not in shown:
            continue
        thing = instance.object
        if thing.type not in ("MESH", "CURVE", "SURFACE", "FONT", "META") or len(found) >= MOST_INSTANCES:
            continue
        data = thing.data
        if data is None:
            continue
        if data not in made:
            made[data] = _mesh_of(bpy, thing, data, graph)
        found.append((instance.parent.original, thing.original, made[data], instance.matrix_world.copy()))
    for parent, shown_thing, mesh, place in found:
        thing = bpy.data.objects.new(f"{parent.name} instance", mesh)
        thing.matrix_world = place
        for flag in VISIBLE:
            setattr(thing, flag, getattr(parent, flag) and getattr(shown_thing, flag))
        scene.collection.objects.link(thing)
        shown.add(thing.name)
    owners = sorted({parent.name for parent, _, _, _ in found})
    for owner in owners:
        thing = scene.objects[owner]
        thing.instance_type = "NONE"
        if thing.type == "MESH" and not (thing.show_instancer_for_render or thing.type == "EMPTY"):
            shown.discard(owner)
    if len(found) >= MOST_INSTANCES:
        notes.append(f"Of its instances the first {MOST_INSTANCES:,} are shown")


def _mesh_of(bpy: Any, thing: Any, data: Any, graph: Any) -> Any:
    """What an instance shows; of geometry nodes that is no mesh of the object's own, though it bears its name."""
    if thing.type == "MESH" and data != thing.original.evaluated_get(graph).data:
        return data.copy()
    return bpy.data.meshes.new_from_object(thing, preserve_all_data_layers=True, depsgraph=graph)


def _modifiers(bpy: Any, scene: Any, shown: set[str], notes: list[str]) -> None:
    """Applies all modifiers but armatures, which the exporter knows as skins; shape keys stand in the way of others."""
    keyed, moving = [], []
    for name in sorted(shown):
        thing = scene.objects[name]
        modifiers = [each for each in thing.modifiers if each.show_viewport and each.type not in ("ARMATURE", "PARTICLE_SYSTEM")]
        if thing.type != "MESH" or not modifiers:
            continue
        if thing.data.shape_keys is not None and len(thing.data.shape_keys.key_blocks) > 1:
            keyed.append(name)
            continue
        if any(
            each.type in ("CLOTH", "SOFT_BODY", "WAVE", "OCEAN", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "FLUID", "BUILD")
            for each in modifiers
        ):
            moving.append(name)
        bent = [each for each in thing.modifiers if each.type == "ARMATURE" and each.show_viewport]
        for each in bent:
            each.show_viewport = False
        graph = bpy.context.evaluated_depsgraph_get()
        thing.data = bpy.data.meshes.new_from_object(thing.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph)
        for each in list(thing.modifiers):
            if each.type not in ("ARMATURE",):
                thing.modifiers.remove(each)
        for each in bent:
            each.show_viewport = True
    if keyed:
        notes.append(f"{_listed(keyed)}: modifiers beside shape keys are not taken over; apply one of both")
    if moving:
        notes.append(f"{_listed(moving)}: stands still as at the frame that the file was saved at; bake it to shape keys")


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more
