"""Writes balls of one principled material each, as .blend and by Blender's own exporters, with Cycles' pictures of all.

    python exported_kit.py FOLDER SIZE SAMPLES MAX_DEPTH [NAME ...]

Run by a Python that has bpy. For each name in MATERIALS: NAME.blend and NAME.blend.exr, the picture of the original scene;
NAME.glb, .usdc and .fbx, and for each the picture of what Blender reads back from it (NAME.glb.exr ...). So losses of an exporter
or importer can be distinguished from those of our readers.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
from cycles_render import as_gltf_says, as_we_have_it
from exported_materials import MATERIALS, SKY, background, stage


def write_glb(path: str) -> None:
    bpy.ops.export_scene.gltf(filepath=path, export_cameras=True, export_animations=False, export_tangents=False)


def read_glb(path: str) -> None:
    bpy.ops.import_scene.gltf(filepath=path)
    for each in bpy.data.materials:
        as_gltf_says(each)


def write_usd(path: str) -> None:
    bpy.ops.wm.usd_export(filepath=path, export_materials=True, generate_preview_surface=True, convert_world_material=False)


def write_fbx(path: str) -> None:
    bpy.ops.export_scene.fbx(filepath=path, bake_anim=False, path_mode="COPY", embed_textures=True, colors_type="LINEAR")


FORMATS = {
    "glb": (write_glb, read_glb),
    "usdc": (write_usd, lambda path: bpy.ops.wm.usd_import(filepath=path)),
    "fbx": (write_fbx, lambda path: bpy.ops.import_scene.fbx(filepath=path)),
}


def picture(path: Path, size: int, samples: int, max_depth: int) -> None:
    scene = bpy.context.scene
    scene.camera = scene.camera or next(thing for thing in scene.objects if thing.type == "CAMERA")
    if scene.world is None:
        scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value, background(scene).inputs["Strength"].default_value = (*SKY, 1), 1.0
    as_we_have_it(scene, size, max_depth)
    scene.cycles.samples = samples
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main(folder: Path, size: int, samples: int, max_depth: int, names: list[str]) -> None:
    """Writes the files and pictures of these materials; of all materials if `names` is empty."""
    for name in names or MATERIALS:
        ball = stage()
        MATERIALS[name](ball)
        scene = bpy.context.scene
        scene.render.resolution_x = scene.render.resolution_y = size
        scene.cycles.max_bounces = max_depth - 2
        blend = folder / f"{name}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        for kind, (write, _) in FORMATS.items():
            write(str(folder / f"{name}.{kind}"))
        picture(folder / f"{name}.blend.exr", size, samples, max_depth)
        for kind, (_, read) in FORMATS.items():
            bpy.ops.wm.read_factory_settings(use_empty=True)
            read(str(folder / f"{name}.{kind}"))
            picture(folder / f"{name}.{kind}.exr", size, samples, max_depth)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), *map(int, sys.argv[2:5]), sys.argv[5:])
