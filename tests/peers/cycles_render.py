"""Renders GLB files in Blender's Cycles, as raw linear EXR. Run by a Python that has bpy: nothing of ours is imported here.

    python cycles_render.py jobs.json

jobs.json: a list of {glb, exr, size, samples, max_depth, sky}; max_depth counts path segments as Rayfarm does, sky is a
radiance that comes from everywhere.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy


def render(glb: str, exr: str, size: int, samples: int, max_depth: int, sky: list[float]) -> None:
    """One picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=glb)
    scene = bpy.context.scene
    scene.camera = next(o for o in scene.objects if o.type == "CAMERA")
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*sky, 1)
    scene.world = world
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = False
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = exr
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0
    # Their bounce 0 is what light adds at the camera's first hit: the second segment of a path.
    bounces = max_depth - 2
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.volume_bounces = bounces
    cycles.transparent_max_bounces = 64
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    for job in json.loads(Path(sys.argv[1]).read_text()):
        render(**job)
