"""Writes scenes with all objects, bones, lights and cameras that Blender's exporters support, and Blender's values of these.

    python values_kit.py FOLDER [NAME ...]

Run by a Python that has bpy. Writes NAME-KIND.SUFFIX for each of FILES, and told.json: the dependency graph's values by scene and
frame. Z is up, and a unit is a metre.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from mathutils import Euler, Matrix, Vector
from values_files import CRASHES, FILES

FRAMES = (1, 4, 9)
FPS = 24
SCENES: dict[str, Callable[[], None]] = {}


def scene(build: Callable[[], None]) -> Callable[[], None]:
    """Registers a function that builds a scene."""
    SCENES[build.__name__] = build
    return build


def placed(name: str, data: Any, parent: Any = None, **place: Any) -> Any:
    """Adds an object to the scene, and returns it."""
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.parent = parent
    for key, value in place.items():
        setattr(made, key, value)
    return made


def wedge(name: str) -> Any:
    """Returns a mesh without any rotational or mirror symmetry."""
    mesh = bpy.data.meshes.new(name)
    corners = [(0, 0, 0), (1, 0, 0), (0, 0.6, 0), (0, 0, 0.3), (0.8, 0.5, 0.1)]
    mesh.from_pydata(corners, [], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)])
    mesh.uv_layers.new(name="UVMap")
    return mesh


def moved(owner: Any, path: str, *values: Any) -> None:
    """Animates a property of `owner`, with one value for each of FRAMES. path: name of the property."""
    for frame, value in zip(FRAMES, values, strict=True):
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame)


@scene
def hierarchy() -> None:
    """Adds objects whose parents are scaled non-uniformly, mirrored, rotated in every rotation mode, or moving.

    Some have parent inverse matrices and delta transforms.
    """
    root = placed("root", None, location=(1, 2, 0.5), rotation_euler=(0.3, -0.2, 0.9), scale=(1, 2, 0.5))
    moved(root, "location", (1, 2, 0.5), (2, 2, 1), (3, 1, 1))
    below = placed("below", wedge("below"), root, location=(0.5, 0.3, 1), rotation_euler=(0.7, 0.1, -0.4))
    moved(below, "rotation_euler", (0.7, 0.1, -0.4), (1.7, 0.1, -0.4), (2.7, 1.1, -0.4))
    placed("deep", wedge("deep"), below, location=(0, 1, 0), rotation_euler=(0.2, 1.1, 0.4), scale=(0.5, 1, 2))
    mirrored = placed("mirrored", wedge("mirrored"), root, location=(-1, 0, 0), scale=(-1, 1, 1.5))
    placed("twice", mirrored.data, mirrored, location=(0, 0, 2), scale=(1, -2, 1), rotation_euler=(0, 0.5, 0))
    axis = placed("axis", wedge("axis"), location=(4, 0, 0))
    axis.rotation_mode, axis.rotation_axis_angle = "AXIS_ANGLE", (1.2, 0.6, 0.0, 0.8)
    turned = placed("quaternion", wedge("quaternion"), location=(4, 2, 0))
    turned.rotation_mode, turned.rotation_quaternion = "QUATERNION", Euler((0.4, 0.9, -1.3)).to_quaternion()
    for order in ("XZY", "YXZ", "ZYX"):
        each = placed(order, wedge(order), location=(6, len(order) + ord(order[0]) - 88, 0), scale=(1, 1.2, 0.8))
        each.rotation_mode, each.rotation_euler = order, (0.4, 0.9, -1.3)
    kept = placed("kept", wedge("kept"), location=(-3, 1, 0))
    bpy.context.view_layer.update()
    kept.parent, kept.matrix_parent_inverse = axis, axis.matrix_world.inverted()
    delta = placed("delta", wedge("delta"), location=(-3, -2, 0))
    delta.delta_location, delta.delta_rotation_euler, delta.delta_scale = (0.5, 0, 1), (0, 0.6, 0), (1, 2, 1)
    follower = placed("follower", wedge("follower"), location=(-5, 0, 0))
    held = follower.constraints.new("COPY_LOCATION")
    held.target, held.use_offset = below, True
    looked = placed("looking", wedge("looking"), location=(-6, 2, 0))
    tracked = looked.constraints.new("TRACK_TO")
    tracked.target, tracked.track_axis, tracked.up_axis = root, "TRACK_X", "UP_Z"


@scene
def rig() -> None:
    """Adds an armature below a rotated and scaled empty, with bones of all inheritance modes, moved by keys and constraints.

    Each bone alone moves a wedge, whose vertices show the joint's position. One mesh is bound to several bones, and has shape
    keys.
    """
    carrier = placed("carrier", None, location=(0.5, -1, 0.2), rotation_euler=(0.1, 0.2, 0.5), scale=(1.5, 1.5, 1.5))
    arm = placed("arm", bpy.data.armatures.new("arm"), carrier, location=(0, 0, 1), rotation_euler=(0, 0.3, 0))
    bpy.context.view_layer.objects.active = arm
    bpy.ops.object.mode_set(mode="EDIT")
    bones = arm.data.edit_bones
    last = None
    for i in range(5):
        bone = bones.new(f"b{i}")
        bone.head, bone.tail, bone.roll = (0.1 * i * i, 0, i), (0.1 * (i + 1) ** 2, 0.1, i + 1), 0.3 * i
        bone.parent, bone.use_connect = last, i in (1, 2)
        last = bone
    hand = bones.new("hand")
    hand.head, hand.tail, hand.parent = (1, 0, 2), (2, 0.5, 2), bones["b1"]
    for name in ("b4", "hand"):
        bones[name].use_deform = True
    goal = bones.new("goal")
    goal.head, goal.tail, goal.use_deform = (3, 1, 3), (3, 1, 3.5), False
    bpy.ops.object.mode_set(mode="OBJECT")
    pose = arm.pose.bones
    for bone in pose:
        bone.rotation_mode = "XYZ"
    moved(pose["b0"], "rotation_euler", (0, 0, 0), (0.2, 0.4, 0), (-0.3, 0.4, 0.6))
    moved(pose["b1"], "rotation_euler", (0, 0.5, 0), (0.9, 0, 0.2), (0.1, 0.3, 0))
    moved(pose["b2"], "scale", (1, 1, 1), (1.3, 1.3, 1.3), (0.7, 0.7, 0.7))
    moved(pose["goal"], "location", (0, 0, 0), (-1, 1, 0), (-1, 2, 1))
    reach = pose["b4"].constraints.new("IK")
    reach.target, reach.subtarget, reach.chain_count = arm, "goal", 2
    copied = pose["hand"].constraints.new("COPY_ROTATION")
    copied.target, copied.subtarget, copied.influence = arm, "b2", 0.5
    bpy.context.view_layer.update()
    for bone in arm.data.bones:
        if bone.use_deform:
            mesh = wedge(f"at {bone.name}")
            mesh.transform(Matrix.Translation(bone.head_local) @ Matrix.Scale(0.3, 4))
            bound(placed(f"at {bone.name}", mesh, arm), arm, {bone.name: lambda v: 1.0})
    tube = tube_along_z()
    skin = placed("skin", tube, arm)
    names = [f"b{i}" for i in range(5)]
    bound(skin, arm, {name: lambda v, i=i: max(1 - abs(v.z - i - 0.5), 0.0) for i, name in enumerate(names)})
    skin.shape_key_add(name="Basis")
    fat, lean = skin.shape_key_add(name="fat"), skin.shape_key_add(name="lean")
    for i, vertex in enumerate(tube.vertices):
        fat.data[i].co = vertex.co + Vector((vertex.co.x, vertex.co.y, 0)) * 0.5
        lean.data[i].co = vertex.co + Vector((0, 0.2 * vertex.co.z, 0))
    lean.slider_min = -1
    moved(fat, "value", 0.0, 1.0, 0.4)
    moved(lean, "value", 0.5, -0.5, 1.0)


def tube_along_z() -> Any:
    rings, sides = 16, 7
    vertices = [
        (0.3 * math.cos(2 * math.pi * k / sides), 0.3 * math.sin(2 * math.pi * k / sides), 5 * r / (rings - 1))
        for r in range(rings)
        for k in range(sides)
    ]
    faces = [
        (r * sides + k, r * sides + (k + 1) % sides, (r + 1) * sides + (k + 1) % sides, (r + 1) * sides + k)
        for r in range(rings - 1)
        for k in range(sides)
    ]
    mesh = bpy.data.meshes.new("skin")
    mesh.from_pydata(vertices, [], faces)
    mesh.uv_layers.new(name="UVMap")
    return mesh


def bound(thing: Any, arm: Any, weights: dict[str, Callable[[Any], float]]) -> None:
    """Binds a mesh to the armature with weights that add up to 1."""
    groups = {name: thing.vertex_groups.new(name=name) for name in weights}
    for vertex in thing.data.vertices:
        each = {name: weight(vertex.co) for name, weight in weights.items()}
        total = sum(each.values())
        for name, weight in each.items():
            if weight > 0:
                groups[name].add([vertex.index], weight / total, "REPLACE")
    thing.modifiers.new("arm", "ARMATURE").object = arm


@scene
def instances() -> None:
    """Adds objects that share a mesh, and nested collection instances: translated, mirrored and moving."""
    inner = bpy.data.collections.new("inner")
    for i in range(2):
        each = placed(f"leaf {i}", wedge(f"leaf {i}"), location=(i, 0.5 * i, 1), rotation_euler=(0.3 * i, 0.2, 0))
        bpy.context.scene.collection.objects.unlink(each)
        inner.objects.link(each)
    inner.instance_offset = (0.2, 0.1, 0)
    outer = bpy.data.collections.new("outer")
    for i in range(2):
        each = placed(f"twig {i}", None, location=(0, 2 * i, 0), rotation_euler=(0, 0, i), scale=(1, 1 + i, 1))
        each.instance_type, each.instance_collection = "COLLECTION", inner
        bpy.context.scene.collection.objects.unlink(each)
        outer.objects.link(each)
    for i in range(3):
        scale = (1, -1 if i == 1 else 1, 1)
        each = placed(f"tree {i}", None, location=(4 * i, 0, 0), rotation_euler=(0, 0.2 * i, 0.4), scale=scale)
        each.instance_type, each.instance_collection = "COLLECTION", outer
    moved(bpy.data.objects["tree 2"], "location", (8, 0, 0), (8, 1, 0), (8, 1, 2))
    shared = wedge("shared")
    for i in range(4):
        placed(f"of one {i}", shared, location=(i, -3, 0), scale=(1, 1, 1 + i), rotation_euler=(i, 0, 0))


@scene
def seen() -> None:
    """Adds cameras of every sensor fit and lens type, each with a parent, and lights of every kind."""
    placed("wedge", wedge("wedge"))
    carrier = placed("crane", None, location=(0, -3, 1), rotation_euler=(0.2, 0.1, 0.6), scale=(2, 2, 2))
    moved(carrier, "location", (0, -3, 1), (1, -3, 1), (1, -4, 2))
    for i, (name, values) in enumerate(
        {
            "plain": {"lens": 35.0},
            "tall": {"lens": 50.0, "sensor_fit": "VERTICAL", "sensor_height": 18.0},
            "wide": {"lens": 24.0, "sensor_fit": "HORIZONTAL", "sensor_width": 30.0},
            "shifted": {"lens": 40.0, "shift_x": 0.1, "shift_y": -0.2, "clip_start": 0.3, "clip_end": 70.0},
            "plan": {"type": "ORTHO", "ortho_scale": 7.0},
            "sharp": {"lens": 80.0},
        }.items()
    ):
        data = bpy.data.cameras.new(name)
        for key, value in values.items():
            setattr(data, key, value)
        if name == "sharp":
            data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = True, 4.5, 1.4
        eye = placed(name, data, carrier if i % 2 else None, location=(i, -6, 1 + i), rotation_euler=(1.2, 0.1 * i, 0.2 * i))
        if name == "plain":
            bpy.context.scene.camera = eye
            for frame, lens in zip(FRAMES, (35.0, 50.0, 85.0), strict=True):
                data.lens = lens
                data.keyframe_insert("lens", frame=frame)
    for i, (name, kind, energy, color, values) in enumerate(
        (
            ("point", "POINT", 400.0, (1, 0.8, 0.6), {"shadow_soft_size": 0.2}),
            ("tiny", "POINT", 30.0, (0.2, 0.3, 1), {"shadow_soft_size": 0.0}),
            ("sun", "SUN", 2.5, (1, 1, 0.9), {"angle": 0.05}),
            ("spot", "SPOT", 700.0, (0.6, 0.8, 1), {"spot_size": 0.9, "spot_blend": 0.3, "shadow_soft_size": 0.1}),
            ("sharp spot", "SPOT", 500.0, (1, 1, 1), {"spot_size": 1.4, "spot_blend": 0.0, "shadow_soft_size": 0.0}),
            ("square", "AREA", 100.0, (1, 0.5, 0.2), {"shape": "SQUARE", "size": 0.7}),
            ("oblong", "AREA", 120.0, (0.4, 1, 0.7), {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.4}),
            ("disk", "AREA", 80.0, (0.9, 0.9, 1), {"shape": "DISK", "size": 0.8}),
        )
    ):
        data = bpy.data.lights.new(name, kind)
        data.energy, data.color = energy, color
        for key, value in values.items():
            setattr(data, key, value)
        placed(name, data, carrier if i in (0, 3) else None, location=(i - 3, 2, 3), rotation_euler=(0.4 * i, 0.3, 0.1 * i))


PAINTS: dict[str, dict[str, Any]] = {
    "paint": {"Base Color": (0.81, 0.12, 0.034, 1), "Roughness": 0.37, "Metallic": 0.0, "IOR": 1.45},
    "metal": {"Base Color": (0.91, 0.62, 0.134, 1), "Roughness": 0.23, "Metallic": 1.0},
    "half": {"Base Color": (0.31, 0.42, 0.534, 1), "Roughness": 0.61, "Metallic": 0.43, "IOR": 1.6},
    "glow": {"Base Color": (0.1, 0.1, 0.1, 1), "Emission Color": (0.2, 0.5, 0.9, 1), "Emission Strength": 3.7},
    "dim": {"Base Color": (0.1, 0.1, 0.1, 1), "Emission Color": (0.2, 0.5, 0.9, 1), "Emission Strength": 0.4},
    "veil": {"Base Color": (0.5, 0.9, 0.6, 1), "Alpha": 0.42},
    "coated": {"Base Color": (0.2, 0.1, 0.6, 1), "Coat Weight": 0.8, "Coat Roughness": 0.13},
    "glassy": {"Base Color": (0.9, 0.95, 1.0, 1), "Transmission Weight": 0.85, "IOR": 1.33, "Roughness": 0.05},
    "velvet": {"Base Color": (0.2, 0.05, 0.3, 1), "Sheen Weight": 0.7, "Sheen Tint": (0.9, 0.8, 0.7, 1), "Sheen Roughness": 0.45},
    "tinted": {"Base Color": (0.3, 0.3, 0.3, 1), "Specular IOR Level": 0.35, "Specular Tint": (0.4, 0.6, 1.0, 1)},
    "brushed": {"Base Color": (0.9, 0.9, 0.9, 1), "Metallic": 1.0, "Anisotropic": 0.6, "Anisotropic Rotation": 0.15},
}


@scene
def paints() -> None:
    """Adds a mesh for each material of PAINTS."""
    for i, (name, values) in enumerate(PAINTS.items()):
        made = bpy.data.materials.new(name)
        made.use_nodes = True
        for key, value in values.items():
            made.node_tree.nodes["Principled BSDF"].inputs[key].default_value = value
        if name == "brushed":
            tangent = made.node_tree.nodes.new("ShaderNodeTangent")
            tangent.direction_type, tangent.uv_map = "UV_MAP", "UVMap"
            made.node_tree.links.new(tangent.outputs[0], made.node_tree.nodes["Principled BSDF"].inputs["Tangent"])
        mesh = wedge(name)
        mesh.materials.append(made)
        placed(name, mesh, location=(2 * i, 0, 0))


def told_of_materials() -> dict[str, Any]:
    """Returns every number and colour input of the principled BSDFs."""
    found = {}
    for name in PAINTS:
        inputs = bpy.data.materials[name].node_tree.nodes["Principled BSDF"].inputs
        values = {each.name: getattr(each, "default_value", None) for each in inputs}
        found[name] = {key: list(v) if hasattr(v, "__len__") else v for key, v in values.items() if v is not None}
    return found


def scene_values(frame: int) -> dict[str, Any]:
    """Returns meshes (concatenated, with triangle counts), bones, cameras and lights as Blender evaluates them at a frame."""
    here = bpy.context.scene
    here.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    found: dict[str, Any] = {"meshes": [], "bones": {}, "cameras": {}, "lights": {}}
    for each in graph.object_instances:
        thing, matrix = each.object, each.matrix_world.copy()
        if thing.type == "MESH":
            mesh = thing.to_mesh()
            mesh.calc_loop_triangles()
            corners = [[*(matrix @ v.co)] for v in mesh.vertices]
            found["meshes"].append([thing.name, len(mesh.loop_triangles), corners])
            thing.to_mesh_clear()
        elif thing.type == "ARMATURE":
            for bone in thing.pose.bones:
                found["bones"][bone.name] = [list(row) for row in matrix @ bone.matrix]
        elif thing.type == "CAMERA":
            data = thing.data
            frame_of = [list(v) for v in data.view_frame(scene=here)]
            found["cameras"][thing.name] = {
                "matrix": [list(row) for row in matrix],
                "frame": frame_of,
                "kind": data.type,
                "near": data.clip_start,
                "lens": data.lens,
                "focus": data.dof.focus_distance if data.dof.use_dof else None,
                "stop": data.dof.aperture_fstop,
            }
        elif thing.type == "LIGHT":
            data = thing.data
            found["lights"][thing.name] = {
                "matrix": [list(row) for row in matrix],
                "kind": data.type,
                "energy": data.energy,
                "color": list(data.color),
                "radius": getattr(data, "shadow_soft_size", 0.0),
                "size": [getattr(data, "size", 0.0), getattr(data, "size_y", 0.0)],
                "shape": getattr(data, "shape", ""),
                "spot": [getattr(data, "spot_size", 0.0), getattr(data, "spot_blend", 0.0)],
                "angle": getattr(data, "angle", 0.0),
            }
    return found


def main(folder: Path, names: list[str]) -> None:
    """Writes the scenes with these names."""
    found: dict[str, Any] = {}
    for name in names or SCENES:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        here = bpy.context.scene
        here.render.fps, here.frame_start, here.frame_end = FPS, FRAMES[0], FRAMES[-1]
        here.render.resolution_x, here.render.resolution_y = 640, 400
        SCENES[name]()
        here.frame_set(FRAMES[0])
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"))
        found[name] = {frame: scene_values(frame) for frame in FRAMES}
        if name == "paints":
            found[name]["materials"] = told_of_materials()
        for kind, (suffix, write, options) in FILES.items():
            if (name, kind) in CRASHES:
                continue
            bpy.ops.wm.open_mainfile(filepath=str(folder / f"{name}.blend"))
            bpy.context.scene.frame_set(FRAMES[0])
            try:
                write(str(folder / f"{name}-{kind}{suffix}"), **options)
            except Exception as error:
                print("NOT WRITTEN", name, kind, error, file=sys.stderr)
    (folder / "told.json").write_text(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
