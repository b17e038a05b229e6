"""Renders views of a scene with BlenderProc's functions. Run by a Python that has bpy and blenderproc; imports none of our code.

    python blenderproc_views.py job.json

job.json: {meshes: [{name, vertices, triangles, color, emission}], poses, size, fov, spp, max_depth, threads, folder,
reference_spp}. BlenderProc 2.8 runs inside Blender's own program; here its modules are imported without its package's set-up,
which would install packages. Prints one line of JSON.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

os.environ["OUTSIDE_OF_THE_INTERNAL_BLENDER_PYTHON_ENVIRONMENT_BUT_IN_RUN_SCRIPT"] = "1"

import blenderproc
import bpy
import numpy as np
from blenderproc.python.camera import CameraUtility
from blenderproc.python.renderer import FlowRendererUtility, RendererUtility, SegMapRendererUtility
from blenderproc.python.utility import Initializer
from blenderproc.python.utility.Utility import Utility, reset_keyframes


def start() -> None:
    """Does what BlenderProc's `init` does, without setting the language: Blender as a module has only its own."""
    Initializer.clean_up(clean_up_camera=True)
    bpy.context.scene.render.engine = "CYCLES"
    RendererUtility.set_render_devices(use_only_cpu=True)
    Initializer._Initializer.set_default_parameters()


def build(meshes: list[dict[str, Any]]) -> None:
    """Makes an object of each mesh, with a Lambertian material that may also emit."""
    for number, mesh in enumerate(meshes, 1):
        data = bpy.data.meshes.new(mesh["name"])
        data.from_pydata(mesh["vertices"], [], mesh["triangles"])
        thing = bpy.data.objects.new(mesh["name"], data)
        thing["category_id"] = number
        bpy.context.scene.collection.objects.link(thing)
        material = bpy.data.materials.new(mesh["name"])
        material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        nodes.clear()
        output, diffuse = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (*mesh["color"], 1)
        surface = diffuse.outputs[0]
        if any(mesh["emission"]):
            emission, both = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
            emission.inputs["Color"].default_value = (*mesh["emission"], 1)
            links.new(surface, both.inputs[0])
            links.new(emission.outputs[0], both.inputs[1])
            side, front = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMixShader")  # emits from its front alone
            links.new(side.outputs["Backfacing"], front.inputs[0])
            links.new(both.outputs[0], front.inputs[1])
            links.new(surface, front.inputs[2])
            surface = front.outputs[0]
        links.new(surface, output.inputs["Surface"])
        data.materials.append(material)


def set_up(size: int, fov: float, spp: int, max_depth: int, threads: int) -> None:
    """Sets BlenderProc's and Cycles' options to values that Rayfarm has too."""
    CameraUtility.set_intrinsics_from_blender_params(math.radians(fov), size, size, lens_unit="FOV")
    RendererUtility.set_cpu_threads(threads)
    RendererUtility.set_denoiser(None)
    RendererUtility.set_noise_threshold(0)
    RendererUtility.set_max_amount_of_samples(spp)
    RendererUtility.set_world_background([0.0, 0.0, 0.0], 0.0)
    bounces = max_depth - 2  # Cycles' bounce 0 is direct light at the first hit, the second segment of a path
    RendererUtility.set_light_bounces(bounces, bounces, 0, bounces, bounces, 8, bounces)
    cycles = bpy.context.scene.cycles
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.blur_glossy = cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0


def frames(poses: list[Any]) -> None:
    """Sets the camera's poses, a frame each."""
    reset_keyframes()
    for number, pose in enumerate(poses):
        CameraUtility.add_camera_pose(np.array(pose), number)


def render_all(folder: Path) -> dict[str, float]:
    """Renders and annotates all frames, and writes each array into a file. Returns the seconds of each part."""
    took, now = {}, time.perf_counter()
    found = dict(RendererUtility.render(str(folder)))
    took["colour, depth and normals"] = time.perf_counter() - now
    now = time.perf_counter()
    found |= SegMapRendererUtility.render_segmap(str(folder), str(folder), map_by="instance")
    took["instances"], now = time.perf_counter() - now, time.perf_counter()
    found |= FlowRendererUtility.render_optical_flow(str(folder), str(folder))
    took["flow"], now = time.perf_counter() - now, time.perf_counter()
    for name in ("colors", "depth", "normals", "instance_segmaps", "forward_flow", "backward_flow"):
        for number, array in enumerate(found[name]):
            np.save(folder / f"{number}-{name}.npy", array)
    took["files"] = time.perf_counter() - now
    return took


def error_of(job: dict[str, Any], folder: Path) -> float:
    """Returns the relative RMSE of the first view's linear pixels against more samples."""
    bpy.context.scene.render.use_compositing = False
    RendererUtility.set_output_format("OPEN_EXR", 32, False)
    frames(job["poses"][:1])
    pictures = []
    for spp, seed in ((job["spp"], 1), (job["reference_spp"], 2)):
        RendererUtility.set_max_amount_of_samples(spp)
        bpy.context.scene.cycles.seed = seed
        bpy.context.scene.frame_set(0)
        bpy.context.scene.render.filepath = str(folder / f"error-{spp}.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(bpy.context.scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        pictures.append(np.array(image.pixels[:]).reshape(-1, 4)[:, :3])
    one, reference = pictures
    return float(np.sqrt(((one - reference) ** 2).mean()) / reference.mean())


def main() -> None:
    """Renders two views to load everything, then measures all views, then the error."""
    job = json.loads(Path(sys.argv[1]).read_text())
    folder = Path(job["folder"])
    out = os.dup(1)
    os.dup2(2, 1)  # Blender prints what it does
    start()
    build(job["meshes"])
    set_up(job["size"], job["fov"], job["spp"], job["max_depth"], job["threads"])
    RendererUtility.enable_depth_output(activate_antialiasing=False, output_dir=str(folder))
    RendererUtility.enable_normals_output(str(folder))
    frames(job["poses"][:2])
    RendererUtility.render(str(folder), return_data=False)  # loads Cycles
    frames(job["poses"])
    begun = time.perf_counter()
    parts = render_all(folder)
    seconds = time.perf_counter() - begun
    found = {"seconds": seconds, "parts": parts, "error": error_of(job, folder)}
    found |= {
        "version": getattr(blenderproc, "__version__", "") or str(Utility.get_current_version()),
        "blender": bpy.app.version_string,
    }
    os.write(out, json.dumps(found).encode() + b"\n")


if __name__ == "__main__":
    main()
