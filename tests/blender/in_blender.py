"""What tests/blender/test_in_blender.py has Blender do. Run by a Python that has bpy: nothing of ours is imported but the add-on.

    python in_blender.py FOLDER URL TASK [TOKEN]

FOLDER has the add-on's package; what a task makes, it writes there. The last line printed is JSON.
"""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path

import bpy

FOLDER, URL, TASK = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
TOKEN = sys.argv[4] if len(sys.argv) > 4 else ""
SIZE = 96, 72


def principled(name: str, **values) -> bpy.types.Material:
    """A material by the names of its sockets, with _ for blanks."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    node = material.node_tree.nodes["Principled BSDF"]
    for key, value in values.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return material


def add(primitive: str, material: bpy.types.Material, number: int = 0, smooth: bool = True, **where) -> bpy.types.Object:
    """An object of Blender's own primitives."""
    getattr(bpy.ops.mesh, f"primitive_{primitive}_add")(**where)
    thing = bpy.context.object
    thing.data.materials.append(material)
    thing.pass_index = number
    if smooth:
        bpy.ops.object.shade_smooth()
    return thing


def lamp(kind: str, energy: float, location, **values) -> bpy.types.Object:
    """A light that looks at the middle of the scene."""
    light = bpy.data.lights.new(kind.lower(), kind)
    light.energy = energy
    for key, value in values.items():
        setattr(light, key, value)
    thing = bpy.data.objects.new(kind.lower(), light)
    thing.location = location
    bpy.context.collection.objects.link(thing)
    look(thing)
    return thing


def look(thing: bpy.types.Object, at=(0, 0, 0.6)) -> None:
    """Turns a thing whose -Z looks."""
    import mathutils

    thing.rotation_euler = (mathutils.Vector(at) - thing.location).to_track_quat("-Z", "Y").to_euler()


def empty() -> bpy.types.Scene:
    """A scene without anything, of a small picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value = (0.2, 0.25, 0.35, 1)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.location = (4.5, -5, 3.2)
    camera.data.lens = 45
    look(camera)
    scene.camera = camera
    return scene


def background(scene: bpy.types.Scene) -> bpy.types.Node:
    """The world's shader."""
    return scene.world.node_tree.nodes["Background"]


def table(scene: bpy.types.Scene) -> None:
    """Things of several principled materials on a floor."""
    add("plane", principled("floor", Base_Color=(0.6, 0.55, 0.5, 1), Roughness=0.8), 1, size=12)
    add(
        "uv_sphere", principled("red", Base_Color=(0.7, 0.08, 0.05, 1), Roughness=0.35), 2, location=(-1.2, -0.3, 0.7), radius=0.7
    )
    gold = principled("gold", Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1, Roughness=0.3)
    add("uv_sphere", gold, 3, location=(0.5, 0.6, 0.8), radius=0.8)
    coated = principled("coated", Base_Color=(0.05, 0.2, 0.5, 1), Roughness=0.6, Coat_Weight=1)
    add("cube", coated, 4, smooth=False, location=(1.1, -1.1, 0.45), size=0.9, rotation=(0, 0, 0.6))
    cloth = principled("cloth", Base_Color=(0.1, 0.4, 0.15, 1), Roughness=1, Specular_IOR_Level=0.2)
    add("torus", cloth, 5, location=(-0.3, -1.5, 0.25), major_radius=0.5, minor_radius=0.22)


def use(engine: str, scene: bpy.types.Scene, samples: int) -> None:
    """The engine, with like settings."""
    scene.render.engine = engine
    if engine == "RAYFARM":
        scene.rayfarm.samples, scene.rayfarm.depth, scene.rayfarm.filter = samples, 14, "box"
        return
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", samples, False, False
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 12
    cycles.transparent_max_bounces = 64
    cycles.blur_glossy = cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0


def picture(name: str, scene: bpy.types.Scene, engine: str, samples: int = 256, format: str = "OPEN_EXR") -> str:
    """Renders it into a file of the folder."""
    use(engine, scene, samples)
    scene.render.image_settings.file_format = format
    scene.render.filepath = str(FOLDER / name)
    bpy.ops.render.render(write_still=True)
    return name


def both(name: str, scene: bpy.types.Scene, samples: int = 256) -> None:
    """The same by Cycles and by the farm."""
    for engine in ("CYCLES", "RAYFARM"):
        picture(f"{name}-{engine.lower()}.exr", scene, engine, samples)


def lamps_one_by_one() -> dict:
    """Each kind of light alone."""
    kinds = {
        "sun": ("SUN", 3.0, {"angle": 0.2}),
        "point": ("POINT", 400.0, {"shadow_soft_size": 0.3, "color": (1, 0.8, 0.6)}),
        "spot": ("SPOT", 900.0, {"spot_size": 0.7, "spot_blend": 0.5, "shadow_soft_size": 0.1}),
        "area": ("AREA", 300.0, {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7}),
        "disk": ("AREA", 300.0, {"shape": "DISK", "size": 1.5}),
    }
    for name, (kind, energy, values) in kinds.items():
        scene = empty()
        table(scene)
        background(scene).inputs["Strength"].default_value = 0.0
        lamp(kind, energy, (1.5, -2.5, 4), **values)
        both(f"lamp-{name}", scene)
    return {"names": [f"lamp-{name}" for name in kinds]}


def seen_lamps() -> dict:
    """Lamps that stand in the picture."""
    scene = empty()
    table(scene)
    background(scene).inputs["Strength"].default_value = 0.3
    lamp("POINT", 60.0, (0.2, -0.6, 1.8), shadow_soft_size=0.25)
    area = lamp("AREA", 40.0, (-1.6, 0.8, 1.6), size=0.8)
    look(area, (2, -3, 1))
    both("seen", scene)
    return {"names": ["seen"]}


TASKS = {each.__name__: each for each in (lamps_one_by_one, seen_lamps)}


def main() -> None:
    sys.path.insert(0, str(FOLDER))
    os.environ["RAYFARM_SERVER"], os.environ["RAYFARM_API_TOKEN"] = URL, TOKEN
    import rayfarm_addon

    rayfarm_addon.register()
    print(json.dumps(TASKS[TASK]()), flush=True)
    rayfarm_addon.unregister()


assert math
if __name__ == "__main__":
    main()
