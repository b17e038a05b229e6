"""Writes a shot in which everything moves, as .blend and by Blender's exporters, and Cycles' pictures of it with an open shutter.

    python blur_kit.py FOLDER SIZE SAMPLES MAX_DEPTH

Run by a Python that has bpy. Writes shot.blend, shot.glb, shot.usdc and shot.fbx; SHUTTER-POSITION-SEED.exr, pictures of the
original scene with two seeds, whose difference is Cycles' noise; and KIND-SHUTTER.exr, of what Blender reads back from each file.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import bpy
from cycles_render import as_we_have_it, open_shutter

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blender"))
from blender_scenes import add, background, empty, look, principled

SKY = (0.5, 0.55, 0.6)
FRAME, FRAMES = 6, (0, 12)
SHUTTERS = ((0.5, "CENTER"), (1.0, "CENTER"), (0.5, "START"), (0.5, "END"))


def moved(thing: Any, path: str, *values: Any) -> None:
    for frame, value in zip((0, 6, 12), values, strict=True):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)


def build() -> None:
    scene = empty()
    scene.render.fps, scene.frame_start, scene.frame_end = 24, *FRAMES
    background(scene).inputs["Color"].default_value = (*SKY, 1)
    add("plane", principled("floor", Base_Color=(0.5, 0.45, 0.4, 1), Roughness=1.0), size=16)
    shining = principled("panel", Base_Color=(0, 0, 0, 1), Emission_Color=(1, 0.9, 0.75, 1), Emission_Strength=8.0)
    look(add("plane", shining, size=2, location=(-2, -2, 4.2)), (0, 0, 1))
    block = add("cube", principled("red", Base_Color=(0.8, 0.1, 0.08, 1), Roughness=0.6), smooth=False, size=1.2)
    moved(block, "rotation_euler", (0, 0, 0), (0.4, 2.0, 1.0), (0.8, 4.0, 2.0))
    moved(block, "location", (-2.4, 0, 1), (-1.5, 0, 1.4), (-0.6, 0, 1))
    child = add("uv_sphere", principled("white", Base_Color=(0.9, 0.9, 0.9, 1), Roughness=0.8), radius=0.35)
    child.parent, child.location = block, (0, 0, 1.2)
    ball = add("uv_sphere", principled("blue", Base_Color=(0.1, 0.2, 0.7, 1), Roughness=0.7), radius=0.6)
    moved(ball, "location", (0.2, -1.5, 0.6), (1.4, -1.5, 1.4), (2.6, -1.5, 0.6))
    soft = add("torus", principled("gold", Base_Color=(0.9, 0.6, 0.15, 1), Roughness=0.7), major_radius=0.8, minor_radius=0.3)
    soft.location = (1.2, 1.0, 1.2)
    soft.shape_key_add(name="Basis")
    bent = soft.shape_key_add(name="bent")
    for i, vertex in enumerate(soft.data.vertices):
        bent.data[i].co = (vertex.co.x * 0.5, vertex.co.y * 1.4, vertex.co.z + vertex.co.x)
    moved(bent, "value", 0.0, 0.6, 1.0)
    moved(scene.camera, "location", (-0.6, -8, 3.4), (0, -8, 3.2), (0.6, -8, 3.4))
    scene.camera.data.angle = math.radians(34)
    scene.camera.rotation_euler = (math.radians(73), 0, 0)
    scene.frame_set(FRAME)


WRITERS = {
    "glb": lambda path: bpy.ops.export_scene.gltf(
        filepath=path, export_cameras=True, export_animation_mode="SCENE", export_force_sampling=True,
        export_optimize_animation_size=False, export_anim_scene_split_object=False,
    ),
    "usdc": lambda path: bpy.ops.wm.usd_export(filepath=path, export_animation=True, export_shapekeys=True,
        convert_world_material=False),
    "fbx": lambda path: bpy.ops.export_scene.fbx(
        filepath=path, bake_anim_use_nla_strips=False, bake_anim_use_all_actions=False, bake_anim_simplify_factor=0.0,
    ),
}  # fmt: skip
READERS = {
    "glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    "usdc": lambda path: bpy.ops.wm.usd_import(filepath=path),
    "fbx": lambda path: bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0),
}


def picture(path: Path, size: int, samples: int, max_depth: int, shutter: float, position: str, seed: int) -> None:
    scene = bpy.context.scene
    scene.camera = scene.camera or next(thing for thing in scene.objects if thing.type == "CAMERA")
    if scene.world is None:
        scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value = (*SKY, 1)
    as_we_have_it(scene, size, max_depth)
    scene.render.use_motion_blur = False
    if shutter > 0:
        open_shutter(shutter)
        scene.render.motion_blur_position = position
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.frame_set(FRAME)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main(folder: Path, size: int, samples: int, max_depth: int) -> None:
    """Writes the files, and Cycles' pictures, to the folder."""
    build()
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 0.5
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
    for kind, write in WRITERS.items():
        write(str(folder / f"shot.{kind}"))
    for shutter, position in (*SHUTTERS, (0.0, "CENTER")):
        for seed in (1, 2):
            name = f"{shutter:g}-{position}-{seed}.exr"
            picture(folder / name, size, samples, max_depth, shutter, position, seed)
    for kind, read in READERS.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = 24
        read(str(folder / f"shot.{kind}"))
        picture(folder / f"{kind}-1.exr", size, samples, max_depth, 1.0, "CENTER", 1)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), *map(int, sys.argv[2:5]))
