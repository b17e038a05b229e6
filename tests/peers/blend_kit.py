"""Writes .blend files for tests. Run by a Python that has bpy:

    python blend_kit.py FOLDER

hostile.blend: a driver and a registered script that write FOLDER/ran-* if scripts are enabled; a library and a picture from
FOLDER/outside.
moving.blend: an arm that bends a tube, a following camera with depth of field, lights of every kind, modifiers, instances.
told.json: positions of its vertices, cameras and lights at some frames, in Blender's axes.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy
from mathutils import Vector

FRAMES = (1, 6, 12)


def hostile(folder: Path) -> None:
    """Writes a file with a driver and a registered script, and with references to files outside the folder."""
    outside = folder / "outside"
    outside.mkdir()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made("secret")
    bpy.data.objects["secret"].data.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(outside / "secret.blend"))
    image = bpy.data.images.new("secret", 8, 8)
    image.generated_color = (1, 0, 1, 1)
    image.filepath_raw, image.file_format = str(outside / "secret.png"), "PNG"
    image.save()

    bpy.ops.wm.read_factory_settings(use_empty=True)
    thing = made("thing")
    with bpy.data.libraries.load(str(outside / "secret.blend"), link=True) as (_, wanted):
        wanted.objects = ["secret"]
    bpy.context.scene.collection.objects.link(bpy.data.objects["secret"])
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(outside / "secret.png"))
    material.node_tree.links.new(node.outputs["Color"], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    thing.data.materials.append(material)
    driver = thing.driver_add("location", 0).driver
    driver.type = "SCRIPTED"
    driver.expression = f"__import__('pathlib').Path({str(folder / 'ran-driver')!r}).write_text('x') and 1.0"
    text = bpy.data.texts.new("start.py")
    text.write(f"import pathlib\npathlib.Path({str(folder / 'ran-text')!r}).write_text('x')\n")
    text.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "hostile.blend"))
    bpy.context.preferences.filepaths.use_scripts_auto_execute = True
    bpy.ops.wm.open_mainfile(filepath=str(folder / "hostile.blend"), use_scripts=True)
    ran = sorted(path.name for path in folder.glob("ran-*"))
    assert ran == ["ran-driver", "ran-text"], f"where scripts are on, all of it runs: {ran}"
    for path in folder.glob("ran-*"):
        path.unlink()


def made(name: str, size: float = 1.0):
    bpy.ops.mesh.primitive_cube_add(size=size)
    bpy.context.object.name = name
    return bpy.context.object


def moving(folder: Path) -> dict[str, object]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, FRAMES[0], FRAMES[-1]
    scene.render.resolution_x, scene.render.resolution_y = 320, 160
    tube = bent()
    round_block = made("round", 1.4)
    round_block.location = (-2, 1, 0.7)
    subdivided = round_block.modifiers.new("smooth", "SUBSURF")
    subdivided.levels, subdivided.render_levels = 1, 2
    hidden = made("hidden")
    hidden.hide_render = True
    excluded = made("excluded")
    shelf = bpy.data.collections.new("shelf")
    scene.collection.children.link(shelf)
    scene.collection.objects.unlink(excluded)
    shelf.objects.link(excluded)
    shelf.hide_render = True
    crowd = bpy.data.collections.new("crowd")
    leaf = made("leaf", 0.2)
    scene.collection.objects.unlink(leaf)
    crowd.objects.link(leaf)
    for i in range(3):
        empty = bpy.data.objects.new(f"crowd {i}", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", crowd, (i, 2, 0.1)
        scene.collection.objects.link(empty)
    data = bpy.data.cameras.new("eye")
    data.lens, data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_object = 40, True, 0.8, tube
    camera = bpy.data.objects.new("eye", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    for frame, x in ((FRAMES[0], -1.0), (FRAMES[-1], 1.5)):
        camera.location = (x, -8, 3)
        camera.rotation_euler = (Vector((0, 0, 1)) - camera.location).to_track_quat("-Z", "Y").to_euler()
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    for i, kind in enumerate(("SUN", "POINT", "SPOT", "AREA")):
        lamp = bpy.data.objects.new(kind.lower(), bpy.data.lights.new(kind.lower(), kind))
        lamp.data.energy = 40 * (i + 1)
        lamp.location, lamp.rotation_euler = (i, -i, 4), (0.2 * i, 0.3, 0.1 * i)
        scene.collection.objects.link(lamp)
    moved = bpy.data.objects["point"]
    moved.data.shadow_soft_size = 0.2
    for frame, value in ((FRAMES[0], 40.0), (FRAMES[-1], 400.0)):
        moved.data.energy = value
        moved.data.keyframe_insert("energy", frame=frame)
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    node = world.node_tree.nodes.new("ShaderNodeTexCoord")  # the colour in each direction is that direction's coordinates
    world.node_tree.links.new(node.outputs["Generated"], world.node_tree.nodes["Background"].inputs["Color"])
    scene.world = world
    odd = bpy.data.materials.new("odd")
    odd.use_nodes = True
    noise = odd.node_tree.nodes.new("ShaderNodeTexNoise")
    odd.node_tree.links.new(noise.outputs["Color"], odd.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    height = odd.node_tree.nodes.new("ShaderNodeDisplacement")
    odd.node_tree.links.new(noise.outputs[0], height.inputs["Height"])
    odd.node_tree.links.new(height.outputs[0], odd.node_tree.nodes["Material Output"].inputs["Displacement"])
    round_block.data.materials.append(odd)
    strewn = made("strewn")
    strewn.modifiers.new("points", "NODES").node_group = points_on_faces()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "moving.blend"))
    return {str(frame): scene_values(frame) for frame in FRAMES}


def points_on_faces():
    """Adds geometry nodes that produce points without a surface."""
    tree = bpy.data.node_groups.new("points", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, strewn, shown = (
        tree.nodes.new(kind) for kind in ("NodeGroupInput", "GeometryNodeDistributePointsOnFaces", "NodeGroupOutput")
    )
    tree.links.new(given.outputs[0], strewn.inputs[0])
    tree.links.new(strewn.outputs[0], shown.inputs[0])
    return tree


def bent():
    """Adds a tube along Z and an armature of two bones, of which the upper one rotates."""
    rings, sides = 9, 8
    vertices = [
        (0.4 * math.cos(2 * math.pi * k / sides), 0.4 * math.sin(2 * math.pi * k / sides), r / 2)
        for r in range(rings)
        for k in range(sides)
    ]
    faces = [
        (r * sides + k, r * sides + (k + 1) % sides, (r + 1) * sides + (k + 1) % sides, (r + 1) * sides + k)
        for r in range(rings - 1)
        for k in range(sides)
    ]
    mesh = bpy.data.meshes.new("tube")
    mesh.from_pydata(vertices, [], faces)
    tube = bpy.data.objects.new("tube", mesh)
    bpy.context.collection.objects.link(tube)
    arm = bpy.data.objects.new("arm", bpy.data.armatures.new("arm"))
    bpy.context.collection.objects.link(arm)
    bpy.context.view_layer.objects.active = arm
    bpy.ops.object.mode_set(mode="EDIT")
    lower = arm.data.edit_bones.new("lower")
    lower.head, lower.tail = (0, 0, 0), (0, 0, 2)
    upper = arm.data.edit_bones.new("upper")
    upper.head, upper.tail, upper.parent = (0, 0, 2), (0, 0, 4), lower
    bpy.ops.object.mode_set(mode="OBJECT")
    for name, least, most in (("lower", -1, 2), ("upper", 2, 9)):
        group = tube.vertex_groups.new(name=name)
        group.add([i for i, v in enumerate(vertices) if least <= v[2] < most], 1.0, "REPLACE")
    tube.modifiers.new("arm", "ARMATURE").object = arm
    tube.parent = arm
    bone = arm.pose.bones["upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((FRAMES[0], 0.0), (FRAMES[-1], 1.2)):
        bone.rotation_euler = (angle, 0, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)
    return tube


def scene_values(frame: int) -> dict[str, object]:
    scene = bpy.context.scene
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    tube = bpy.data.objects["tube"].evaluated_get(graph)
    mesh = tube.to_mesh()
    camera = bpy.data.objects["eye"].evaluated_get(graph)
    return {
        "tube": [list(tube.matrix_world @ v.co) for v in mesh.vertices],
        "eye": [list(row) for row in camera.matrix_world],
        "focus": abs(
            (bpy.data.objects["tube"].matrix_world.translation - camera.matrix_world.translation).dot(
                camera.matrix_world.to_3x3() @ Vector((0, 0, -1))
            )
        ),
        "energy": bpy.data.objects["point"].data.energy,
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1]).resolve()
    hostile(folder)
    (folder / "told.json").write_text(json.dumps(moving(folder)))
