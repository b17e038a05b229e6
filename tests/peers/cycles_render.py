"""Renders GLB files in Blender's Cycles as raw linear EXR. Run by a Python that has bpy; imports none of our code.

    python cycles_render.py jobs.json

jobs.json: a list of {glb, exr, size, samples, max_depth, sky, frame, shutter, vectors}; max_depth counts path segments as
Rayfarm does, sky is the radiance of a uniform sky. Where Blender's importer interprets a number differently from glTF's
specification, `as_gltf_says` corrects the result; docs/correctness.md lists the size of each effect.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy


def as_gltf_says(material: bpy.types.Material) -> None:
    """Corrects values that Blender's importer interprets differently from glTF's specification."""
    nodes = material.node_tree.nodes if material.use_nodes else []
    for node in nodes:
        if node.type == "VOLUME_ABSORPTION":
            # Blender absorbs (1 - colour) * density per unit; glTF's colour is what remains after a distance of 1 / density.
            density = node.inputs["Density"].default_value
            depth = [-math.log(max(c, 1e-6)) for c in node.inputs["Color"].default_value[:3]]
            node.inputs["Density"].default_value = density * max(depth)
            node.inputs["Color"].default_value = (*(1 - d / max(*depth, 1e-6) for d in depth), 1)
        if node.type == "LIGHT_PATH":
            # Unlit materials: Blender's importer makes them visible to the camera only, while other rays pass through.
            links = material.node_tree.links
            emission = next(n for n in nodes if n.type == "EMISSION")
            output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
            links.new(emission.outputs["Emission"], output.inputs["Surface"])
        if node.type == "BSDF_PRINCIPLED":
            roughness, strength = node.inputs["Roughness"].default_value, node.inputs["Anisotropic"].default_value
            if strength > 0:
                # Blender's alphas are roughness**2 divided and multiplied by sqrt(1 - 0.9 strength); glTF changes only one of
                # them.
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
    """Renders one picture of a GLB file to an EXR file.

    frame: frame number of a file with motion, at 24 per second. shutter: open time in frames, centred on the frame. vectors:
    whether to write motion vectors too.
    """
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
    """Enables motion blur in Cycles, with nine motion steps for each object. length: shutter time in frames."""
    scene = bpy.context.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = length
    scene.render.motion_blur_position = "CENTER"
    for thing in scene.objects:
        thing.cycles.use_motion_blur = thing.cycles.use_deform_motion = True
        thing.cycles.motion_steps = 3


def prepare(glb: str, size: int, max_depth: int, sky: list[float]) -> None:
    """Loads the GLB file into Blender, and sets its camera and the Cycles settings that Rayfarm supports too."""
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
    """Sets Cycles' options to values that Rayfarm supports: a square picture without clamping of samples."""
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
    # Cycles' bounce 0 is direct light at the first hit, which is the second segment of a path.
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
