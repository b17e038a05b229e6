"""Program that renders a scene of hard light with Cycles, in a Python that has bpy."""

from __future__ import annotations

import math
import time
from typing import Any

import bpy
import mathutils

from tests.benchmarks.hard.blender_scene import BlenderLamp, BlenderMesh, BlenderScene, blender_scene
from tests.benchmarks.hard.scenes import DEPTH, SCENES, SIZE, Surface
from tests.benchmarks.peers.answering import answer
from tests.peers.cycles_render import as_we_have_it

_TRAINING = 128  # Blender's default


def load(scene: str, method: str) -> dict[str, Any]:
    """Builds a scene. method: plain, guided (OpenPGL), or caustics (shadow caustics by manifold next event estimation)."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = blender_scene(SCENES[scene](), with_lamps=method == "caustics")
    _build(made, method == "caustics")
    settings = bpy.context.scene
    as_we_have_it(settings, SIZE, DEPTH)
    settings.render.threads_mode, settings.render.threads = "FIXED", 1
    settings.render.image_settings.exr_codec = "NONE"
    settings.view_settings.view_transform = "Raw"
    settings.cycles.use_guiding = method == "guided"
    settings.cycles.guiding_training_samples = _TRAINING
    return {"version": f"Blender {bpy.app.version_string}"}


def render(samples: int, seed: int, path: str, plain: bool = False) -> dict[str, Any]:
    """Renders the scene to an EXR file, and returns the processor time. plain: without guiding."""
    scene = bpy.context.scene
    guided = scene.cycles.use_guiding
    scene.cycles.use_guiding = guided and not plain
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.render.filepath = f"{path}.exr"
    used = time.process_time()
    bpy.ops.render.render(write_still=True)
    used = time.process_time() - used
    scene.cycles.use_guiding = guided
    return {"seconds": used, "samples": samples, "path": scene.render.filepath}


def _build(made: BlenderScene, has_caustics: bool) -> None:
    scene = bpy.context.scene
    materials = {name: _material(name, surface) for name, surface in made.surfaces.items()}
    for mesh in made.meshes:
        thing = _mesh(mesh, materials[mesh.surface])
        scene.collection.objects.link(thing)
        if has_caustics:
            thing.cycles.is_caustics_caster, thing.cycles.is_caustics_receiver = mesh.is_caster, not mesh.is_caster
    for lamp in made.lamps:
        scene.collection.objects.link(_lamp(lamp))
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*made.sky, 1)
    scene.world = world
    if made.sun is not None:
        direction, color, strength = made.sun
        sun = bpy.data.lights.new("sun", "SUN")
        sun.angle, sun.color, sun.energy = 0.0, color, strength
        thing = bpy.data.objects.new("sun", sun)
        thing.rotation_mode = "QUATERNION"
        thing.rotation_quaternion = mathutils.Vector(direction).to_track_quat("-Z", "Y")
        scene.collection.objects.link(thing)
    camera = bpy.data.cameras.new("main")
    camera.sensor_fit, camera.angle = "VERTICAL", math.radians(made.fov)
    camera.clip_start, camera.clip_end = 1e-3, 1e5
    thing = bpy.data.objects.new("main", camera)
    eye, target = mathutils.Vector(made.eye), mathutils.Vector(made.target)
    thing.location = eye
    thing.rotation_mode = "QUATERNION"
    thing.rotation_quaternion = (target - eye).to_track_quat("-Z", "Y")
    scene.collection.objects.link(thing)
    scene.camera = thing


def _material(name: str, surface: Surface) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    if surface.kind == "matte":
        node = tree.nodes.new("ShaderNodeBsdfDiffuse")
        node.inputs["Color"].default_value = (*surface.color, 1)
        node.inputs["Roughness"].default_value = 0.0
    elif surface.kind == "glass":
        node = tree.nodes.new("ShaderNodeBsdfGlass")
        node.inputs["Color"].default_value = (1, 1, 1, 1)
        node.inputs["Roughness"].default_value = 0.0
        node.inputs["IOR"].default_value = surface.ior
    else:  # emits from its front only
        node = tree.nodes.new("ShaderNodeEmission")
        node.inputs["Color"].default_value = (*surface.color, 1)
        front = tree.nodes.new("ShaderNodeMath")
        front.operation = "SUBTRACT"
        front.inputs[0].default_value = 1.0
        tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], front.inputs[1])
        tree.links.new(front.outputs[0], node.inputs["Strength"])
        material.cycles.emission_sampling = "FRONT"
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def _mesh(mesh: BlenderMesh, material: bpy.types.Material) -> bpy.types.Object:
    data = bpy.data.meshes.new(mesh.name)
    data.from_pydata(mesh.positions.tolist(), [], mesh.triangles.tolist())
    data.update()
    if mesh.normals is not None:
        data.polygons.foreach_set("use_smooth", [True] * len(mesh.triangles))
        data.normals_split_custom_set_from_vertices(mesh.normals.tolist())
    data.materials.append(material)
    return bpy.data.objects.new(mesh.name, data)


def _lamp(lamp: BlenderLamp) -> bpy.types.Object:
    data = bpy.data.lights.new(lamp.name, "AREA")
    data.shape, (data.size, data.size_y) = "RECTANGLE", lamp.size
    data.color, data.energy = lamp.color, lamp.energy
    data.cycles.is_caustics_light = True
    data.cycles.max_bounces = 1024
    thing = bpy.data.objects.new(lamp.name, data)
    turn = mathutils.Matrix([lamp.x_axis, lamp.y_axis, lamp.z_axis]).transposed()
    thing.matrix_world = mathutils.Matrix.Translation(lamp.center) @ turn.to_4x4()
    return thing


if __name__ == "__main__":
    answer({"load": load, "render": render})
