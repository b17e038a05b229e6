"""Writes one generated scene in every format that Blender writes; Cycles renders what Blender reads back from each.

    python formats_kit.py FOLDER SIZE SAMPLES MAX_DEPTH

Run by a Python that has bpy. Writes scene.NAME and NAME.exr for each of FORMATS; the picture for `blend` is of the original
scene.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from cycles_render import as_we_have_it
from mathutils import Vector

WORLD = (0.35, 0.4, 0.5)
WITH_PANELS = ("blend", "usdc")  # glTF and Collada have no area lights; Blender reads those of FBX as points
SAYS_ALL = True  # with a lens shift, and Blender's own penumbra of a spot, which differs from glTF's
PLAIN = False  # only diffuse surfaces: Blender's Collada lacks roughness and specular level


def build(folder: Path, name: str) -> None:
    """Builds the scene from those features that the format `name` can store.

    The scene is a wavy checkered floor with four bodies, each with a material, and four lights.
    """
    global PLAIN, SAYS_ALL
    PLAIN, SAYS_ALL = name == "dae", name in ("blend", "fbx", "usdc")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    floor = surface("floor", lambda u, v: (8 * u - 4, 8 * v - 4, 0.08 * math.sin(9 * u) * math.cos(7 * v)), 48, 48)
    floor.data.materials.append(textured("tiles", chequered(folder)))
    ring = surface("ring", torus(0.9, 0.33), 64, 32)
    ring.location, ring.rotation_euler = (-1.1, 0.3, 1.0), (1.1, 0.2, 0.4)
    ring.data.materials.append(material("gold", (0.9, 0.6, 0.15), Metallic=1.0, Roughness=0.35))
    for called, place, radius, made in (
        ("matt", (0.9, -0.9, 0.75), 0.65, material("clay", (0.7, 0.2, 0.12), Roughness=1.0)),
        ("gloss", (1.5, 0.9, 0.75), 0.65, material("plastic", (0.08, 0.25, 0.6), Roughness=0.3)),
    ):
        ball = surface(called, sphere(radius), 64, 32)
        ball.location = place
        ball.data.materials.append(made)
    block = surface("block", sphere(0.8, 4), 4, 2)
    block.location, block.rotation_euler, block.scale = (-0.9, -1.5, 0.5), (0, 0, 0.5), (1, 0.7, 0.8)
    for polygon in block.data.polygons:
        polygon.use_smooth = False
    block.data.materials.append(material("steel", (0.55, 0.55, 0.58), Metallic=1.0, Roughness=0.6))
    lamp("sun", "SUN", 1.5, (0, 0, 5), (-1.0, 0.5, -1.6), angle=0.0)
    lamp("point", "POINT", 120, (-2.5, -2.5, 2.8), (0, 0, -1), color=(1.0, 0.7, 0.4))
    lamp(
        "spot",
        "SPOT",
        500,
        (2.5, -2.0, 3.5),
        (-0.7, 0.7, -1.1),
        color=(0.5, 0.8, 1.0),
        spot_size=0.9,
        spot_blend=0.5 if SAYS_ALL else 0.0,
    )
    if name in WITH_PANELS:  # visible in the picture, hidden from Cycles' camera, and between sun and floor
        lamp("panel", "AREA", 90, (0.3, 1.2, 2.3), (-0.4, -1.4, -1.2), shape="RECTANGLE", size=1.6, size_y=0.8)
    data = bpy.data.cameras.new("camera")
    data.angle = 0.7
    if SAYS_ALL:
        data.shift_x, data.shift_y = 0.06, -0.04
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    camera.location = (0.4, -7.2, 3.6)
    camera.rotation_euler = Vector((-0.04, 0.9, -0.38)).to_track_quat("-Z", "Y").to_euler()
    scene.camera = camera
    light_up(scene)
    bpy.context.view_layer.update()


def light_up(scene: bpy.types.Scene) -> None:
    """Adds a uniform sky to the scene."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*WORLD, 1)
    scene.world = world


def surface(name, point, across, along):
    """Adds a smooth mesh with vertices point(u, v), whose UVs cover the unit square; returns it.

    across, along: number of quads in u and in v.
    """
    vertices = [point(i / across, j / along) for j in range(along + 1) for i in range(across + 1)]
    row = across + 1
    faces = [
        (j * row + i, j * row + i + 1, (j + 1) * row + i + 1, (j + 1) * row + i) for j in range(along) for i in range(across)
    ]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    layer = mesh.uv_layers.new(name="UVMap")
    for loop in mesh.loops:
        i, j = loop.vertex_index % row, loop.vertex_index // row
        layer.data[loop.index].uv = (i / across, j / along)
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    mesh.update()
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def torus(large, small):
    return lambda u, v: (
        (large + small * math.cos(2 * math.pi * v)) * math.cos(2 * math.pi * u),
        (large + small * math.cos(2 * math.pi * v)) * math.sin(2 * math.pi * u),
        small * math.sin(2 * math.pi * v),
    )


def sphere(radius, power=2):
    """Returns the function point(u, v) of a superquadric: a ball for power 2, closer to a block for larger powers."""

    def point(u, v):
        x, y = math.cos(2 * math.pi * u), math.sin(2 * math.pi * u)
        z, r = -math.cos(math.pi * v), math.sin(math.pi * v)
        p = (x * r, y * r, z)
        length = sum(abs(c) ** power for c in p) ** (1 / power)
        return tuple(radius * c / length for c in p)

    return point


def material(name, color, **inputs):
    if PLAIN:
        inputs = {"Roughness": 1.0, "Specular IOR Level": 0.0}
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    node = made.node_tree.nodes["Principled BSDF"]
    node.inputs["Base Color"].default_value = (*color, 1)
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    return made


def textured(name, image):
    made = material(name, (1, 1, 1), Roughness=0.9)
    node = made.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    made.node_tree.links.new(node.outputs["Color"], made.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made


def chequered(folder: Path) -> bpy.types.Image:
    image = bpy.data.images.new("tiles", 64, 64)
    row, column = np.mgrid[:64, :64] // 8
    pixels = np.ones((64, 64, 4), np.float32)
    pixels[..., :3] = np.where(((row + column) % 2)[..., None], (0.85, 0.8, 0.7), (0.25, 0.45, 0.35))
    pixels[:16, :16, :3] = (0.8, 0.3, 0.2)  # marks one corner, so that orientation is visible
    image.pixels = pixels.ravel()
    image.filepath_raw, image.file_format = str(folder / "tiles.png"), "PNG"
    image.save()
    return bpy.data.images.load(str(folder / "tiles.png"))


def lamp(name, kind, watts, place, towards, **more):
    data = bpy.data.lights.new(name, kind)
    data.energy = watts
    if kind in ("POINT", "SPOT"):
        data.shadow_soft_size = 0.0
    for key, value in more.items():
        setattr(data, key, value)
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.location = place
    made.rotation_euler = Vector(towards).to_track_quat("-Z", "Y").to_euler()


def usd_out(path):
    bpy.ops.wm.usd_export(filepath=path, export_materials=True, generate_preview_surface=True, export_textures_mode="KEEP")


FORMATS = {
    "glb": (
        lambda path: bpy.ops.export_scene.gltf(filepath=path, export_lights=True, export_cameras=True, export_animations=False),
        lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ),
    "fbx": (
        lambda path: bpy.ops.export_scene.fbx(filepath=path, bake_anim=False, path_mode="RELATIVE"),
        lambda path: bpy.ops.import_scene.fbx(filepath=path),
    ),
    "usdc": (usd_out, lambda path: bpy.ops.wm.usd_import(filepath=path, import_visible_only=False)),
    "dae": (
        lambda path: bpy.ops.wm.collada_export(filepath=path),
        lambda path: bpy.ops.wm.collada_import(filepath=path),
    ),
}


def picture(path: Path, size: int, samples: int, max_depth: int) -> None:
    scene = bpy.context.scene
    scene.camera = scene.camera or next(thing for thing in scene.objects if thing.type == "CAMERA")
    as_we_have_it(scene, size, max_depth)
    scene.cycles.samples = samples
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def lights_and_materials() -> dict[str, object]:
    """Returns the values of all lights and materials in Blender, to show what an exporter or importer loses."""
    lights = {
        thing.name: [thing.data.type, thing.data.energy, list(thing.data.color), getattr(thing.data, "shadow_soft_size", 0)]
        for thing in bpy.context.scene.objects
        if thing.type == "LIGHT"
    }
    materials = {}
    for made in bpy.data.materials:
        node = made.node_tree.nodes.get("Principled BSDF") if made.use_nodes else None
        if node is not None:
            names = ("Base Color", "Metallic", "Roughness", "IOR", "Specular IOR Level", "Emission Strength")
            materials[made.name] = {n: _plain(node.inputs[n].default_value) for n in names if n in node.inputs}
    return {"lights": lights, "materials": materials, "world": bpy.context.scene.world.name if bpy.context.scene.world else None}


def _plain(value):
    return list(value) if hasattr(value, "__len__") else value


if __name__ == "__main__":
    folder, (size, samples, depth) = Path(sys.argv[1]), map(int, sys.argv[2:5])
    only = sys.argv[5:] or ["blend", *FORMATS]
    notes = {}
    for name in only:
        build(folder, name)
        path = folder / f"scene.{name}"
        if name == "blend":
            bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = size
            bpy.context.scene.cycles.max_bounces = depth - 2
            bpy.ops.file.pack_all()
            bpy.ops.wm.save_as_mainfile(filepath=str(path))
        else:
            write, read = FORMATS[name]
            bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = size
            if not hasattr(bpy.ops.wm, "collada_export") and name == "dae":
                continue
            write(str(path))
            bpy.ops.wm.read_factory_settings(use_empty=True)
            read(str(path))
        notes[name] = lights_and_materials()
        if bpy.context.scene.world is None or name in ("glb", "fbx", "dae"):
            light_up(bpy.context.scene)
        picture(folder / f"{name}.exr", size, samples, depth)
    (folder / "told.json").write_text(json.dumps(notes, indent=1))
