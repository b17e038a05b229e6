"""Lists the meshes that are rendered according to Blender's dependency graph. Run by a Python that has bpy."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

SHOWN = ("MESH", "CURVE", "SURFACE", "META", "FONT")


def told(frame: int) -> list[list[Any]]:
    """Returns (name, bounds, triangle count) of each mesh that Blender renders at this frame."""
    scene = bpy.context.scene
    for each in bpy.data.collections:
        each.hide_viewport = False  # makes the viewport's graph contain what is rendered
    scene.frame_set(frame)
    bpy.context.view_layer.update()
    found = []
    graph = bpy.context.evaluated_depsgraph_get()
    hidden = {name for name in ("unrendered", "below unrendered", "cutter") if name in bpy.data.objects}
    for instance in graph.object_instances:
        each = instance.object
        owner = instance.parent if instance.is_instance else each
        if each.type not in SHOWN or each.name in hidden or owner.hide_render:
            continue
        if not instance.is_instance and each.is_instancer and not each.show_instancer_for_render:
            continue
        if not instance.is_instance and each.parent is not None and each.parent.instance_type in ("VERTS", "FACES"):
            continue  # in renders, unlike the viewport, such objects are visible only as instances
        mesh = each.to_mesh()
        if mesh is None:
            continue
        mesh.calc_loop_triangles()
        points = np.empty(3 * len(mesh.vertices), np.float64)
        mesh.vertices.foreach_get("co", points)
        place = np.array(instance.matrix_world)
        world = points.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3]
        if len(mesh.loop_triangles):
            found.append([each.name, world.min(axis=0).tolist(), world.max(axis=0).tolist(), len(mesh.loop_triangles)])
        each.to_mesh_clear()
    return found
