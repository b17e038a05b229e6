"""Changes the open scene so that it appears as in a render and contains only objects that the glTF exporter supports.

Modifiers are applied, and instances become objects with meshes.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from .deforming_meshes import DeformedShapes, armatures_disabled
from .hair import hair_maker, particle_hair_as_objects
from .instances import VISIBLE, instances_as_objects
from .keys import animated_paths
from .large import Taken
from .sentences import Sentence, first_items

__all__ = ["VISIBLE", "prepare"]

GREY = 0.8


def prepare(
    bpy: Any, scene: Any, frames: list[int], exposed: list[int], addon: Path | None, taken: Taken, notes: list[str]
) -> list[Any]:
    """Prepares the open scene at the first of `frames`; returns the visible objects.

    exposed: the frames, extended by those that the shutter overlaps. addon: the add-on's folder, or None. taken: receives the
    fibres of particle hair (hair.py). notes: receives warnings.
    """
    _copy_render_settings_to_viewport(bpy, scene)
    bpy.context.view_layer.update()
    blinking = sorted(thing.name for thing in scene.objects if any(path == "hide_render" for path in animated_paths(thing)))
    if blinking and len(frames) > 1:
        notes.append(
            Sentence(
                "blend-animated-visibility",
                "{names}: animated visibility is ignored; shown or hidden as at the first frame",
                names=first_items(blinking, 5),
            )
        )
    shown = _rendered_objects(bpy, scene)
    nowhere = sorted(name for name in shown if not _has_finite_transform(scene.objects[name]))
    if nowhere:
        notes.append(
            Sentence(
                "blend-position-not-finite", "{names}: left out, since the position is not finite", names=first_items(nowhere, 5)
            )
        )
        for name in nowhere:  # objects with a non-finite transform cannot be exported, even if hidden
            shown.remove(name)
            bpy.data.objects.remove(scene.objects[name])
    particle_hair_as_objects(bpy, scene, shown, addon, taken, notes)
    instances_as_objects(bpy, scene, shown, frames, hair_maker(bpy, addon, taken, notes), notes)
    _apply_modifiers(bpy, scene, shown, frames, exposed, notes)
    for thing in scene.objects:
        thing.hide_render = thing.name not in shown and thing.type not in ("EMPTY", "ARMATURE")
    found = [thing for thing in scene.objects if thing.name in shown]
    _apply_overrides(bpy.context.view_layer, scene, found)
    _add_default_materials(bpy, found)
    return found


def _has_finite_transform(thing: Any) -> bool:
    return all(math.isfinite(each) for row in thing.matrix_world for each in row)


def _copy_render_settings_to_viewport(bpy: Any, scene: Any) -> None:
    """Copies the visibility and modifier settings for renders to those for the viewport, which the exporter uses."""
    _visible_as_rendered(bpy)
    scene.render.simplify_subdivision = scene.render.simplify_subdivision_render
    scene.render.simplify_child_particles = scene.render.simplify_child_particles_render
    for thing in bpy.data.objects:
        for modifier in thing.modifiers:
            modifier.show_viewport = modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                modifier.levels = modifier.render_levels
        if thing.type in ("CURVE", "SURFACE", "FONT") and thing.data.render_resolution_u:
            thing.data.resolution_u = thing.data.render_resolution_u
        for system in getattr(thing, "particle_systems", ()):
            settings = system.settings
            settings.display_percentage, settings.display_step = 100, settings.render_step
            settings.child_percent = settings.rendered_child_count


def _visible_as_rendered(bpy: Any) -> None:
    """Sets the viewport visibility of all objects to their render visibility.

    Otherwise objects hidden only in the viewport would not be evaluated, and objects hidden only in renders would be instanced.
    """
    for each in [*bpy.data.objects, *bpy.data.collections]:
        each.hide_viewport = each.hide_render
    left = [bpy.context.view_layer.layer_collection]
    while left:
        each = left.pop()
        each.hide_viewport = False
        left += each.children
    for thing in bpy.context.view_layer.objects:
        thing.hide_set(False)


def _apply_overrides(layer: Any, scene: Any, objects: list[Any]) -> None:
    """Applies the view layer's material override to all objects, and its world override."""
    material = getattr(layer, "material_override", None)
    for thing in objects if material is not None else ():
        if not hasattr(thing.data, "materials"):
            continue
        if not thing.material_slots:
            thing.data.materials.append(material)
        for slot in thing.material_slots:
            slot.material = material
    if getattr(layer, "world_override", None) is not None:
        scene.world = layer.world_override


def _add_default_materials(bpy: Any, objects: list[Any]) -> None:
    """Replaces materials without nodes by diffuse ones, as Cycles does, and missing materials by a grey one."""
    grey = bpy.data.materials.new("no material")
    grey.use_nodes = False
    grey.diffuse_color = (GREY, GREY, GREY, 1.0)
    for thing in objects:
        if not hasattr(thing.data, "materials"):
            continue
        if not thing.material_slots:
            thing.data.materials.append(grey)
        for slot in thing.material_slots:
            if slot.material is None:
                slot.material = grey
            if not slot.material.use_nodes:
                _make_diffuse(slot.material)


def _make_diffuse(material: Any) -> None:
    color = tuple(material.diffuse_color)[:3]
    material.use_nodes = True
    node = material.node_tree.nodes["Principled BSDF"]
    for name, value in (("Base Color", (*color, 1.0)), ("Metallic", 0.0), ("Roughness", 1.0), ("Specular IOR Level", 0.0)):
        node.inputs[name].default_value = value


def _rendered_objects(bpy: Any, scene: Any) -> set[str]:
    """Returns the names of objects that are rendered: not hidden, in a visible collection, not excluded from the view layer."""
    layer = set(bpy.context.view_layer.objects.keys())
    hidden = {collection.name for collection in [*scene.collection.children_recursive] if collection.hide_render}

    def is_hidden(thing: Any) -> bool:
        homes = list(thing.users_collection)
        return bool(homes) and all(_is_in_hidden_collection(home, hidden, scene) for home in homes)

    return {thing.name for thing in scene.objects if not thing.hide_render and thing.name in layer and not is_hidden(thing)}


def _is_in_hidden_collection(collection: Any, hidden: set[str], scene: Any) -> bool:
    """Returns True if a collection, or one that contains it, is in the set `hidden`."""
    if collection.name in hidden:
        return True
    parents = [each for each in scene.collection.children_recursive if collection.name in each.children]
    return bool(parents) and all(_is_in_hidden_collection(parent, hidden, scene) for parent in parents)


def _apply_modifiers(
    bpy: Any, scene: Any, visible_names: set[str], frames: list[int], exposed: list[int], notes: list[str]
) -> None:
    """Applies all modifiers of the visible meshes except armatures, which the exporter writes as skins.

    Modifiers that deform a mesh over time are replaced by shape keys. Other modifiers of meshes that already have shape keys
    cannot be applied.
    """
    keyed = []
    bending = DeformedShapes(bpy, scene, visible_names, exposed if len(frames) > 1 else frames)
    scene.frame_set(frames[0])
    for name in sorted(visible_names):
        thing = scene.objects[name]
        modifiers = [each for each in thing.modifiers if each.show_viewport and each.type not in ("ARMATURE", "PARTICLE_SYSTEM")]
        if thing.type != "MESH" or not modifiers:
            continue
        if thing.data.shape_keys is not None and len(thing.data.shape_keys.key_blocks) > 1:
            keyed.append(name)
            continue
        with armatures_disabled([thing]):
            graph = bpy.context.evaluated_depsgraph_get()
            shape = bpy.data.meshes.new_from_object(thing.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph)
        thing.data = shape
        for each in list(thing.modifiers):
            if each.type not in ("ARMATURE",):
                thing.modifiers.remove(each)
        bending.add_shape_keys(thing)
    if keyed:
        notes.append(
            Sentence(
                "blend-modifiers-and-shape-keys",
                "{names}: modifiers of meshes with shape keys are ignored; apply either of them",
                names=first_items(keyed, 5),
            )
        )
    if bending.left:
        notes.append(
            Sentence(
                "blend-deformation-first-frame",
                "{names}: deformation by modifiers is shown as at the first frame, since the number "
                "of vertices changes or is too large",
                names=first_items(bending.left, 5),
            )
        )
