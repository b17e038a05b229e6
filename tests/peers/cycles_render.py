"""Renders GLB files in Blender's Cycles, as raw linear EXR. Run by a Python that has bpy: nothing of ours is imported here.

    python cycles_render.py jobs.json

jobs.json: a list of {glb, exr, size, samples, max_depth, sky, frame, shutter, vectors}; max_depth counts path segments as
Rayfarm does, sky is a radiance that comes from everywhere. Where Blender's importer takes a number in another sense than
glTF's specification says, `as_gltf_says` corrects what it imported; docs/correctness.md has how much each makes.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy


def as_gltf_says(material: bpy.types.Material) -> None:
    """Corrects the importer's liberties."""
    nodes = material.node_tree.nodes if material.use_nodes else []
    for node in nodes:
        if node.type == "VOLUME_ABSORPTION":
            # Theirs absorbs (1 - colour) * density per unit; glTF's colour is what is left after a distance, 1 / density.
            density = node.inputs["Density"].default_value
            depth = [-math.log(max(c, 1e-6)) for c in node.inputs["Color"].default_value[:3]]
            node.inputs["Density"].default_value = density * max(depth)
            node.inputs["Color"].default_value = (*(1 - d / max(*depth, 1e-6) for d in depth), 1)
        if node.type == "LIGHT_PATH":
            # Unlit: they let only the camera see it, and all other rays pass through.
            links = material.node_tree.links
            emission = next(n for n in nodes if n.type == "EMISSION")
            output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
            links.new(emission.outputs["Emission"], output.inputs["Surface"])
        if node.type == "BSDF_PRINCIPLED":
            roughness, strength = node.inputs["Roughness"].default_value, node.inputs["Anisotropic"].default_value
            if strength > 0:
                # alpha along and across are roughness**2 over and times sqrt(1 - 0.9 strength); glTF stretches the one alone.
                across = roughness**2
                along = across + (1 - across) * strength**2
                node.inputs["Roughness"].default_value = (along * across) ** 0.25
                node.inputs["Anisotropic"].default_value = (1 - across / along) / 0.9


def render(
    glb: str,
    exr: str,
    size: int,
    samples: int,
    max_depth: int,
    sky: list[float],
    frame: int | None = None,
    shutter: float | None = None,
    vectors: bool = False,
) -> None:
    """One picture. frame: of a file that moves, by 24 a second. shutter: of a frame's time, centred. vectors: beside it."""
    prepare(glb, size, max_depth, sky)
    if shutter is not None:
        open_shutter(shutter)
    if vectors:
        bpy.context.view_layer.use_pass_vector = True
        bpy.context.scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    if frame is not None:
        bpy.context.scene.frame_set(frame)
    bpy.context.scene.render.filepath = exr
    bpy.context.scene.cycles.samples = samples
    bpy.ops.render.render(write_still=True)


def open_shutter(length: float) -> None:
    """Blurs what moves, by nine keys of each thing."""
    scene = bpy.context.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = length
    scene.render.motion_blur_position = "CENTER"
    for thing in scene.objects:
        thing.cycles.use_motion_blur = thing.cycles.use_deform_motion = True
        thing.cycles.motion_steps = 3


def prepare(glb: str, size: int, max_depth: int, sky: list[float]) -> None:
    """The file is Blender's scene, seen by its camera, with Cycles' settings those that we have too."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=glb)
    for material in bpy.data.materials:
        as_gltf_says(material)
    scene = bpy.context.scene
    scene.camera = next(o for o in scene.objects if o.type == "CAMERA")
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*sky, 1)
    scene.world = world
    as_we_have_it(scene, size, max_depth)


def as_we_have_it(scene: bpy.types.Scene, size: int, max_depth: int) -> None:
    """Cycles' settings, those that we have too: square pictures, every sample counted as it is."""
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = False
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.device = "CPU"
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


if __name__ == "__main__":
    for job in json.loads(Path(sys.argv[1]).read_text()):
        render(**job)
