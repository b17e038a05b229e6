"""Writes the FBX files of tests/data/fbx with Blender's own exporter, and the values that Blender has for the same scene.

Run by a Python that has bpy: python tests/peers/fbx_kit.py FOLDER
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

FRAMES = (0, 5, 12)
EXPORT = {
    "add_leaf_bones": False,
    "bake_anim_use_all_actions": False,
    "bake_anim_use_nla_strips": False,
    "bake_anim_simplify_factor": 0.0,
}


def material(name, **inputs):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    for key, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[key.replace("_", " ")].default_value = value
    return made


def picture(name, folder):
    image = bpy.data.images.new(name, 4, 4)
    row, column = np.mgrid[:4, :4]
    pixels = np.ones((4, 4, 4), np.float32)
    pixels[..., 0], pixels[..., 1] = (row + column) % 2, row / 3
    image.pixels = pixels.ravel()
    image.filepath_raw, image.file_format = str(folder / name), "PNG"
    image.save()
    return bpy.data.images.load(str(folder / name))


def textured(name, image):
    made = material(name, Roughness=0.6)
    node = made.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    made.node_tree.links.new(node.outputs["Color"], made.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made


def placed(name, data, **place):
    found = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(found)
    for key, value in place.items():
        setattr(found, key, value)
    return found


def moved(thing, path, start, end):
    for frame, value in ((FRAMES[0], start), (FRAMES[-1], end)):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)


def added(what, name, *materials, **place):
    getattr(bpy.ops.mesh, f"primitive_{what}_add")(**place)
    found = bpy.context.object
    found.name = name
    for each in materials:
        found.data.materials.append(each)
    return found


def build(folder):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, FRAMES[0], FRAMES[-1]
    scene.render.resolution_x, scene.render.resolution_y = 640, 360
    red = material("red", Base_Color=(0.8, 0.1, 0.05, 1), Roughness=0.35)
    gold = material("gold", Base_Color=(0.9, 0.6, 0.1, 1), Roughness=0.2, Metallic=1.0)
    glow = material("glow", Base_Color=(0.1, 0.1, 0.1, 1), Emission_Color=(0.2, 0.5, 1.0, 1), Emission_Strength=3.0)
    pane = material("pane", Base_Color=(0.5, 0.9, 0.6, 1), Roughness=0.1, Alpha=0.4)

    cube = added("cube", "cube", red, gold)
    for i in (0, 1):
        cube.data.polygons[i].material_index = 1
    cube.rotation_euler, cube.scale = (0.3, 0.5, -0.7), (1, 2, 0.5)
    moved(cube, "location", (1, 2, 3), (2, 2, 4))
    ball = added("uv_sphere", "ball", glow, segments=8, ring_count=4, radius=0.7)
    bpy.ops.object.shade_smooth()
    ball.parent, ball.location = cube, (0, 0, 2)
    placed("twin", ball.data, location=(-3, 0, 1))
    added("plane", "floor", textured("checked", picture("checks.png", folder)), size=12)
    sheet = bpy.data.meshes.new("sheet")
    sheet.from_pydata([(-1, 0, 0), (1, 0, 0), (1, 0, 2), (-1, 0, 2), (0, 0, 0.5)], [], [(0, 4, 1, 2, 3)])  # concave
    sheet.materials.append(pane)
    placed("pane", sheet, location=(-2, -3, 0))

    grid = added("grid", "grid", gold, x_subdivisions=3, y_subdivisions=3, location=(3, -2, 0.5))
    grid.shape_key_add(name="flat")
    key = grid.shape_key_add(name="up")
    for i, vertex in enumerate(grid.data.vertices):
        key.data[i].co = vertex.co + Vector((0, 0, math.cos(vertex.co.x * 2) * 0.8))
    moved(key, "value", 0.25, 1.0)

    tube = added("cylinder", "tube", red, vertices=6, radius=0.3, depth=4, location=(-3, 3, 2))
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=1)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.armature_add(location=(-3, 3, 0))
    rig = bpy.context.object
    rig.name = "rig"
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.data.edit_bones
    bones[0].name, bones[0].head, bones[0].tail = "low", (0, 0, 0), (0, 0, 2)
    high = bones.new("high")
    high.head, high.tail, high.parent = (0, 0, 2), (0, 0, 4), bones["low"]
    bpy.ops.object.mode_set(mode="OBJECT")
    tube.select_set(True)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.parent_set(type="ARMATURE")
    for name, weigh in (("low", lambda share: 1 - share), ("high", lambda share: share)):
        group = tube.vertex_groups.new(name=name)
        for vertex in tube.data.vertices:
            group.add([vertex.index], weigh(min(max((vertex.co.z + 1) / 2, 0), 1)), "REPLACE")
    bend = rig.pose.bones["high"]
    bend.rotation_mode = "XYZ"
    moved(bend, "rotation_euler", (0, 0, 0), (1.2, 0, 0.4))

    for kind, place, energy, color, turn in (
        ("POINT", (0, 0, 5), 500, (1, 0.9, 0.8), (0, 0, 0)),
        ("SUN", (0, 0, 8), 2.5, (1, 1, 0.9), (0.5, 0.3, 0)),
        ("SPOT", (4, -4, 6), 800, (0.6, 0.8, 1), (0.7, 0.1, 0.6)),
        ("AREA", (-5, 0, 5), 300, (1, 1, 1), (0, -0.8, 0)),
    ):
        light = bpy.data.lights.new(kind.lower(), kind)
        light.energy, light.color = energy, color
        if kind == "SPOT":
            light.spot_size, light.spot_blend = math.radians(50), 0.3
        placed(kind.lower(), light, location=place, rotation_euler=turn)
    lens = bpy.data.cameras.new("main")
    lens.lens = 35
    main = placed("main", lens)
    main.rotation_euler = Vector((-9, 9, -5)).to_track_quat("-Z", "Y").to_euler()
    moved(main, "location", (9, -9, 6), (9, -7, 6))
    scene.camera = main
    plan = bpy.data.cameras.new("plan")
    plan.type, plan.ortho_scale = "ORTHO", 9
    placed("plan", plan, location=(0, 0, 12))


def said():
    """Returns the values that Blender evaluates for each object at each frame: world vertices, camera position, light."""
    found = {}
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        objects = found[frame] = {}
        for thing in bpy.context.scene.objects:
            shown = thing.evaluated_get(graph)
            said = objects[thing.name] = {"type": thing.type, "matrix": [list(row) for row in shown.matrix_world]}
            if thing.type == "MESH":
                mesh = shown.to_mesh()
                mesh.calc_loop_triangles()
                said["triangles"] = len(mesh.loop_triangles)
                said["vertices"] = [[round(c, 6) for c in shown.matrix_world @ vertex.co] for vertex in mesh.vertices]
                shown.to_mesh_clear()
    return found


def main(folder):
    build(folder)
    (folder / "kit.json").write_text(json.dumps(said(), separators=(",", ":")) + "\n")
    bpy.context.scene.frame_set(0)
    bpy.ops.export_scene.fbx(filepath=str(folder / "kit.fbx"), path_mode="COPY", embed_textures=True, **EXPORT)
    (folder / "checks.png").unlink()


main(Path(sys.argv[1]).resolve())
