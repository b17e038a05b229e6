"""Converts hair curves to meshes of thin tubes, and point clouds to spheres, which the glTF exporter supports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .instances import VISIBLE, is_left_out
from .point_clouds import mesh_of_points
from .principled_materials import modules_of
from .sentences import Sentence

__all__ = ["hair_and_points_as_meshes"]

MOST_POINTS = 300_000


def hair_and_points_as_meshes(bpy: Any, scene: Any, objects: list[Any], addon: Path | None, notes: list[str]) -> list[Any]:
    """Returns the visible objects, with hair curves and point clouds replaced by meshes where possible.

    addon: the add-on's folder, or None: hair is then not replaced.
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
        tubes = modules_of(addon).tubes.tubes
        made += [_mesh_of(bpy, scene, thing, thing.evaluated_get(graph).data, tubes, notes) for thing in curves]
    gone = {thing.name for thing in (*curves, *clouds)}
    for thing in (*curves, *clouds):
        thing.hide_render = True
    return [*(thing for thing in objects if thing.name not in gone), *(thing for thing in made if thing is not None)]


def _mesh_of(bpy: Any, scene: Any, thing: Any, data: Any, tubes: Any, notes: list[str]) -> Any:
    import numpy as np

    count = len(data.points)
    if not 0 < count <= MOST_POINTS:
        if count:
            notes.append(
                Sentence(
                    "blend-hair-too-large",
                    "{object}: hair of {count} points is left out; at most {limit} are supported",
                    object=thing.name,
                    count=f"{count:,}",
                    limit=f"{MOST_POINTS:,}",
                )
            )
        return None
    points, radii = np.empty(3 * count, np.float32), np.empty(count, np.float32)
    first = np.empty(len(data.curves), np.int32)
    data.points.foreach_get("position", points)
    data.points.foreach_get("radius", radii)
    data.curves.foreach_get("first_point_index", first)
    positions, _, triangles, _ = tubes(points.reshape(-1, 3), radii, np.append(first, np.int32(count)))
    mesh = bpy.data.meshes.new(thing.name)
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), bool))
    mesh.update(calc_edges=True)
    for material in thing.data.materials:
        mesh.materials.append(material)
    return _object_of(bpy, scene, thing, mesh, "hair")


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
