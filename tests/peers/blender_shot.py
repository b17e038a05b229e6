"""Makes a shot in Blender, exports it as a GLB, and writes all positions to a file. Run by a Python that has bpy.

    python blender_shot.py shot.glb shot.json

It also writes shot-plain.glb, without KHR_animation_pointer, which Blender's importer supports in part only, and shot-bent.glb,
in which only the tube's vertices move.

shot.json: {frame: {"matrices": {name: 4x4}, "vertices": {name: [[x, y, z], ...]}, "numbers": {...}}}, in Blender's axes: Z is up.
"""

from __future__ import annotations

import json
import math
import sys

import bpy
from mathutils import Vector

FRAMES = (0, 7, 13, 24, 40)
LAST = 40


def key(owner, path, values, index=-1):
    """Adds keyframes of a property, with Blender's default Bezier handles."""
    for frame, value in values.items():
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame, index=index)


def mesh_object(name, rings=9, sides=8, radius=0.4):
    """Returns a tube along Z, of height 4."""
    vertices = [
        (math.cos(2 * math.pi * k / sides) * radius, math.sin(2 * math.pi * k / sides) * radius, 4 * r / (rings - 1))
        for r in range(rings)
        for k in range(sides)
    ]
    faces = [
        (r * sides + k, r * sides + (k + 1) % sides, (r + 1) * sides + (k + 1) % sides, (r + 1) * sides + k)
        for r in range(rings - 1)
        for k in range(sides)
    ]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    shown = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(shown)
    return shown


def rigid():
    """Adds a mast rotated by Euler angles, a moving and scaled yard on it, and a flag rotated by quaternions."""
    mast, yard, flag = (mesh_object(name, 3, 5, radius) for name, radius in (("mast", 0.4), ("yard", 0.6), ("flag", 0.3)))
    yard.parent, flag.parent = mast, yard
    key(mast, "rotation_euler", {0: (0, 0, 0), 24: (0.4, 0.2, 3.5), 40: (1.1, -0.7, 5.0)})
    key(yard, "location", {0: (0, 0, 2), 16: (1, 0.5, 3), 40: (0, -1, 1)})
    key(yard, "scale", {0: (1, 1, 1), 30: (0.5, 2, 1.5)})
    flag.rotation_mode = "QUATERNION"
    key(flag, "rotation_quaternion", {0: (1, 0, 0, 0), 20: (0.5, 0.5, -0.5, 0.5), 40: (0, 0, 1, 0)})


def camera_and_lamp():
    lens = bpy.data.cameras.new("camera")
    camera = bpy.data.objects.new("camera", lens)
    bpy.context.collection.objects.link(camera)
    camera.rotation_euler = (1.1, 0, 0)
    key(camera, "location", {0: (2, -11, 6), 40: (3, -9, 6)})
    key(lens, "lens", {0: 35.0, 40: 28.0})
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SPOT"))
    bpy.context.collection.objects.link(lamp)
    key(lamp.data, "energy", {0: 100.0, 24: 1000.0, 40: 10.0})
    key(lamp.data, "color", {0: (1, 1, 1), 40: (1, 0.2, 0.1)})
    key(lamp, "location", {0: (4, -4, 6), 40: (-4, -4, 6)})
    key(lamp, "rotation_euler", {0: (0.3, 0, 0), 40: (0.6, 0.2, 1.0)})
    bpy.context.scene.camera = camera


def floor():
    mesh = bpy.data.meshes.new("floor")
    mesh.from_pydata([(-30, -30, 0), (30, -30, 0), (30, 30, 0), (-30, 30, 0)], [], [(0, 1, 2, 3)])
    bpy.context.collection.objects.link(bpy.data.objects.new("floor", mesh))


def paint():
    """Adds grey materials; the mast's colour, roughness and emission are animated."""
    for thing in [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]:
        name = "paint" if thing.name == "mast" else "grey"
        material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
        material.use_nodes = True
        thing.data.materials.append(material)
    inputs = surface(bpy.data.materials["paint"])
    key(inputs["Base Color"], "default_value", {0: (0.8, 0.1, 0.1, 1), 40: (0.1, 0.2, 0.9, 1)})
    key(inputs["Roughness"], "default_value", {0: 0.3, 40: 0.9})
    inputs["Emission Color"].default_value = (1, 0.5, 0.25, 1)
    key(inputs["Emission Strength"], "default_value", {0: 0.0, 40: 1.0})


def surface(material):
    """Returns the inputs of the material's principled BSDF, by socket name."""
    return next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED").inputs


def bent():
    """Adds a tube with three bones, two of them rotating, and shape keys, one driven by the mast's rotation."""
    tube = mesh_object("tube")
    tube.location = (5, 0, 0)
    armature = bpy.data.armatures.new("bones")
    rig = bpy.data.objects.new("rig", armature)
    bpy.context.collection.objects.link(rig)
    rig.location = (5, 0, 0)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    last = None
    for k in range(3):
        bone = armature.edit_bones.new(f"bone {k}")
        bone.head, bone.tail = (0, 0, 4 * k / 3), (0, 0, 4 * (k + 1) / 3)
        bone.parent, bone.use_connect = last, last is not None
        last = bone
    bpy.ops.object.mode_set(mode="OBJECT")
    for k in range(3):
        group = tube.vertex_groups.new(name=f"bone {k}")
        for vertex in tube.data.vertices:
            weight = max(1 - abs(vertex.co.z * 3 / 4 - k - 0.5), 0)
            if weight > 0:
                group.add([vertex.index], weight, "REPLACE")
    for vertex in tube.data.vertices:  # normalises the weights
        total = sum(g.weight for g in vertex.groups)
        for g in vertex.groups:
            g.weight /= total
    tube.parent = rig
    tube.location = (0, 0, 0)
    tube.modifiers.new("rig", "ARMATURE").object = rig
    for name, keys in (
        ("bone 1", {0: (0, 0, 0), 24: (0.9, 0, 0.2), 40: (-0.5, 0.3, 0)}),
        ("bone 2", {0: (0, 0, 0), 13: (0, 0.8, 0)}),
    ):
        bone = rig.pose.bones[name]
        bone.rotation_mode = "XYZ"
        key(bone, "rotation_euler", keys)
    tube.shape_key_add(name="Basis")
    fat, long = tube.shape_key_add(name="fat"), tube.shape_key_add(name="long")
    for k, vertex in enumerate(tube.data.vertices):
        fat.data[k].co = vertex.co + Vector((vertex.co.x, vertex.co.y, 0))
        long.data[k].co = vertex.co + Vector((0, 0, 0.3 * vertex.co.z))
    key(fat, "value", {0: 0.0, 20: 1.0, 40: 0.3})
    driver = long.driver_add("value").driver
    driver.type = "SCRIPTED"
    variable = driver.variables.new()
    variable.name, variable.type = "turn", "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = bpy.data.objects["mast"], "ROT_Z"
    driver.expression = "turn / 5"


def bent_alone():
    """Deletes all bodies but the tube and its floor, and makes the camera and the lamp static."""
    bpy.data.objects["tube"].data.shape_keys.key_blocks["long"].driver_remove("value")
    for name in ("mast", "yard", "flag"):
        bpy.data.objects.remove(bpy.data.objects[name])
    for owner in (bpy.data.objects["camera"], bpy.data.objects["lamp"], bpy.data.cameras["camera"], bpy.data.lights["lamp"]):
        owner.animation_data_clear()
    bpy.data.objects["camera"].location, bpy.data.objects["camera"].rotation_euler = (5, -6, 2.5), (1.5, 0, 0)
    bpy.data.lights["lamp"].type = "POINT"  # the two renderers have different penumbras for spots
    bpy.data.lights["lamp"].energy = 1000.0


def seen():
    """Returns the transforms and vertices of all objects, and all animated numbers, at the current frame."""
    graph = bpy.context.evaluated_depsgraph_get()
    matrices, vertices = {}, {}
    for thing in bpy.context.scene.objects:
        evaluated = thing.evaluated_get(graph)
        matrices[thing.name] = [list(row) for row in evaluated.matrix_world]
        if thing.type == "MESH":
            mesh = evaluated.to_mesh()
            vertices[thing.name] = [list(evaluated.matrix_world @ v.co) for v in mesh.vertices]
            evaluated.to_mesh_clear()
    material = bpy.data.materials["paint"].evaluated_get(graph)
    inputs = surface(material)
    numbers = {
        "fov": math.degrees(bpy.data.cameras["camera"].angle),
        "energy": bpy.data.lights["lamp"].energy,
        "light": list(bpy.data.lights["lamp"].color),
        "color": list(inputs["Base Color"].default_value)[:3],
        "roughness": inputs["Roughness"].default_value,
        "emission": inputs["Emission Strength"].default_value,
    }
    return {"matrices": matrices, "vertices": vertices, "numbers": numbers}


def main(glb, told):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 0, LAST, 24
    scene.render.resolution_x = scene.render.resolution_y = 96
    rigid()
    camera_and_lamp()
    bent()
    floor()
    paint()
    found = {}
    for frame in FRAMES:
        scene.frame_set(frame)
        found[frame] = seen()
    scene.frame_set(0)
    for kind in ("", "-plain", "-bent"):
        if kind == "-bent":
            bent_alone()
        path, pointers = glb.replace(".glb", f"{kind}.glb"), not kind
        bpy.ops.export_scene.gltf(
            filepath=path, export_cameras=True, export_lights=True, export_animation_mode="SCENE", export_force_sampling=True,
            export_optimize_animation_size=False, export_pointer_animation=pointers, export_anim_scene_split_object=False,
        )  # fmt: skip
    with open(told, "w") as file:  # noqa: PTH123
        json.dump(found, file)


main(*sys.argv[-2:])
