"""Writes a shot as an Alembic file, and as a .blend with mesh-deforming modifiers, with Blender's vertex positions of each.

    python alembic_kit.py FOLDER

Run by a Python that has bpy. Writes shot.abc, shot.blend and told.json: by file and frame, the name, triangle count and world
vertices of each mesh, and the camera's position. For the Alembic file these are what Blender reads back from it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

FRAMES = (1, 5, 12)


def moved(thing: Any, path: str, *values: Any) -> None:
    for frame, value in zip(FRAMES, values, strict=True):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)


def build() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, FRAMES[0], FRAMES[-1]
    bpy.ops.mesh.primitive_cube_add(size=1)
    carrier = bpy.context.object
    carrier.name = "carrier"
    moved(carrier, "location", (0, 0, 1), (1, 0, 1), (1, 2, 2))
    moved(carrier, "rotation_euler", (0, 0, 0), (0.5, 0.2, 0), (1, 0.2, 2))
    bpy.ops.mesh.primitive_cone_add(radius1=0.3, depth=0.8)
    child = bpy.context.object
    child.name, child.parent, child.location, child.scale = "child", carrier, (0, 0, 1), (1, 1, 1.5)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=16, y_subdivisions=16, size=4, location=(-3, 0, 0.5))
    sheet = bpy.context.object
    sheet.name = "sheet"
    wave = sheet.modifiers.new("wave", "WAVE")
    wave.height, wave.width, wave.speed, wave.narrowness = 0.6, 1.2, 0.25, 1.2
    bpy.ops.mesh.primitive_torus_add(location=(3, 0, 1), major_segments=16, minor_segments=6)
    soft = bpy.context.object
    soft.name = "soft"
    soft.shape_key_add(name="Basis")
    key = soft.shape_key_add(name="up")
    for i, vertex in enumerate(soft.data.vertices):
        key.data[i].co = vertex.co + Vector((0, 0, vertex.co.x))
    moved(key, "value", 0.0, 1.0, 0.4)
    bpy.ops.mesh.primitive_plane_add(size=12)
    bpy.context.object.name = "floor"
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    scene.collection.objects.link(camera)
    camera.rotation_euler = (1.2, 0, 0)
    moved(camera, "location", (0, -9, 4), (0.5, -9, 4), (1, -8, 4))
    scene.camera = camera


def scene_values() -> dict[int, Any]:
    found = {}
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        meshes, eye = [], None
        for thing in bpy.context.scene.objects:
            shown = thing.evaluated_get(graph)
            if thing.type == "MESH":
                mesh = shown.to_mesh()
                mesh.calc_loop_triangles()
                meshes.append([thing.name, len(mesh.loop_triangles), [[*(shown.matrix_world @ v.co)] for v in mesh.vertices]])
                shown.to_mesh_clear()
            elif thing.type == "CAMERA":
                eye = [list(row) for row in shown.matrix_world]
        found[frame] = {"meshes": meshes, "eye": eye}
    return found


def main(folder: Path) -> None:
    """Writes all files to the folder."""
    build()
    bpy.context.scene.frame_set(FRAMES[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
    says = {"shot.blend": scene_values()}
    bpy.ops.wm.alembic_export(filepath=str(folder / "shot.abc"), start=FRAMES[0], end=FRAMES[-1], as_background_job=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.alembic_import(filepath=str(folder / "shot.abc"), as_background_job=False)
    says["shot.abc"] = scene_values()
    (folder / "told.json").write_text(json.dumps(says))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
