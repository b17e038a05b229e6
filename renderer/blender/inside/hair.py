"""Converts hair curves and particle hair to fibres, and point clouds to spheres.

The glTF exporter gets a stand-in for each mesh of fibres, a triangle with its material (large.py).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .instances import VISIBLE, MakeHair, is_left_out
from .large import Taken, stand_in
from .point_clouds import mesh_of_points
from .principled_materials import modules_of
from .sentences import Sentence

__all__ = ["hair_and_points_as_meshes", "hair_maker", "particle_hair_as_objects"]


def particle_hair_as_objects(bpy: Any, scene: Any, shown: set[str], addon: Path | None, taken: Taken, notes: list[str]) -> None:
    """Adds an object for each particle system of the visible objects that is hair, as it is at the current frame.

    shown: the names of the visible objects; those of the new objects are added. addon: the add-on's folder, or None: hair is then
    left out. taken: receives the fibres, by the names of their stand-ins.
    """
    graph = bpy.context.evaluated_depsgraph_get()
    for thing in [each for each in scene.objects if each.name in shown and len(each.particle_systems)]:
        evaluated = thing.evaluated_get(graph)
        if addon is None:
            _note_left_out(thing, notes)
            continue
        modules = modules_of(addon)
        systems = list(modules.particles.hair_systems(evaluated, False))
        for system in systems:
            found = modules.meshes.particle_hair(evaluated, system, False, thing.name)
            if found is None:
                if len(system.particles):
                    notes.append(_too_large(thing, modules))
                continue
            slot = min(max(system.settings.material - 1, 0), max(len(thing.material_slots) - 1, 0))
            material = thing.material_slots[slot].material if thing.material_slots else None
            mesh = stand_in(bpy, thing.name, [material])
            taken[mesh.name] = found[0]
            shown.add(_object_of(bpy, scene, thing, mesh, system.name).name)
        if systems and not thing.show_instancer_for_render:
            shown.discard(thing.name)


def _note_left_out(thing: Any, notes: list[str]) -> None:
    if any(each.settings.type == "HAIR" and each.settings.render_type == "PATH" for each in thing.particle_systems):
        notes.append(Sentence("blend-particle-hair", "{object}: particle hair is left out", object=thing.name))


def _too_large(thing: Any, modules: Any) -> Sentence:
    return Sentence(
        "blend-hair-too-large",
        "{object}: hair of more than {limit} points is left out",
        object=thing.name,
        limit=f"{modules.particles.MOST_POINTS:,}",
    )


def hair_and_points_as_meshes(
    bpy: Any, scene: Any, objects: list[Any], addon: Path | None, taken: Taken, notes: list[str]
) -> list[Any]:
    """Returns the visible objects, with hair curves and point clouds replaced by meshes where possible.

    addon: the add-on's folder, or None: hair is then not replaced. taken: receives the fibres, by the names of their stand-ins.
    """
    graph = bpy.context.evaluated_depsgraph_get()
    clouds = [thing for thing in objects if thing.type == "POINTCLOUD" and not is_left_out(thing.evaluated_get(graph))]
    curves = [thing for thing in objects if thing.type == "CURVES" and addon is not None]
    if not curves and not clouds:
        return objects
    made = [
        _object_of(bpy, scene, thing, mesh_of_points(bpy, thing.name, thing.evaluated_get(graph).data), "points")
        for thing in clouds
    ]
    if curves:
        assert addon is not None
        modules = modules_of(addon)
        made += [_hair_of(bpy, scene, thing, thing.evaluated_get(graph).data, modules, taken, notes) for thing in curves]
    gone = {thing.name for thing in (*curves, *clouds)}
    for thing in (*curves, *clouds):
        thing.hide_render = True
    return [*(thing for thing in objects if thing.name not in gone), *(thing for thing in made if thing is not None)]


def _hair_of(bpy: Any, scene: Any, thing: Any, data: Any, modules: Any, taken: Taken, notes: list[str]) -> Any:
    mesh = _stand_in_of_hair(bpy, thing, data, modules, taken, notes)
    return None if mesh is None else _object_of(bpy, scene, thing, mesh, "hair")


def _stand_in_of_hair(bpy: Any, thing: Any, data: Any, modules: Any, taken: Taken, notes: list[str]) -> Any:
    """Returns a stand-in for hair curves (`data`, a bpy.types.Curves), whose fibres `taken` receives; None without strands."""
    found = modules.meshes.hair(data, thing.name)
    if found is None:
        if len(data.points):
            notes.append(_too_large(thing, modules))
        return None
    mesh = stand_in(bpy, thing.name, [each.original if each is not None else None for each in data.materials[:1]])
    taken[mesh.name] = found[0]
    return mesh


def hair_maker(bpy: Any, addon: Path | None, taken: Taken, notes: list[str]) -> MakeHair | None:
    """Returns a function that converts an object's hair curves to a stand-in; None without the add-on's folder, `addon`."""
    if addon is None:
        return None
    return lambda thing, data: _stand_in_of_hair(bpy, thing, data, modules_of(addon), taken, notes)


def _object_of(bpy: Any, scene: Any, thing: Any, mesh: Any, what: str) -> Any:
    """Adds an object with a mesh that replaces an object; returns it."""
    made = bpy.data.objects.new(f"{thing.name} {what}", mesh)
    _move_alike(made, thing)
    for flag in VISIBLE:
        setattr(made, flag, getattr(thing, flag))
    scene.collection.objects.link(made)
    return made


def _move_alike(target: Any, thing: Any) -> None:
    """Makes `target` move like the object `thing`: sets the same parent and the same animation."""
    target.rotation_mode = thing.rotation_mode
    target.parent, target.parent_type, target.parent_bone = thing.parent, thing.parent_type, thing.parent_bone
    target.matrix_parent_inverse = thing.matrix_parent_inverse.copy()
    target.matrix_basis = thing.matrix_basis.copy()
    moves = thing.animation_data
    if moves is not None and moves.action is not None:
        data = target.animation_data_create()
        data.action = moves.action
        if getattr(moves, "action_slot", None) is not None:  # since Blender 4.4
            data.action_slot = moves.action_slot
    if thing.constraints:
        target.constraints.new("COPY_TRANSFORMS").target = thing
