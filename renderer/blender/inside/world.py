"""The world: a colour as it is; whatever else it is made of as a picture of all directions, which Cycles takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .keys import animated_paths, rounded

__all__ = ["write_world"]

WIDTH, MOST_WIDTH = 2048, 8192
SAMPLES = 4
# By kind, whether the world is there for rays; and how that is said.
RAYS = {
    "camera": "by the camera",
    "diffuse": "by what it lights",
    "glossy": "in reflections",
    "transmission": "through glass",
}


def write_world(bpy: Any, scene: Any, out: Path, notes: list[str]) -> dict[str, Any] | None:
    """The scene file's environment, with its picture in `out`; None where there is no light from around."""
    world = scene.world
    if world is None:
        return None
    hidden = [words for kind, words in RAYS.items() if not getattr(getattr(world, "cycles_visibility", None), kind, True)]
    if hidden:
        notes.append(f"World: is seen {', '.join(hidden)} here, though not in Blender")
    if animated_paths(world.node_tree if world.use_nodes else world):
        notes.append("World: moves with the frame in Blender, and is as at the first frame here")
    plain = _plain(world)
    if plain is not None:
        return {"color": rounded(plain)} if max(plain) > 0 else None
    nodes = world.node_tree.nodes
    if any(node.type == "LIGHT_PATH" for node in nodes):
        notes.append("World: lights as the camera sees it; by its nodes it shows the camera something else than it lights with")
    output = next((node for node in nodes if node.type == "OUTPUT_WORLD" and node.is_active_output), None)
    if output is not None and output.inputs["Volume"].links:
        notes.append("World: its volume is not taken over")
    if "cycles" not in bpy.context.preferences.addons:
        notes.append("World: its nodes are not taken over, as this Blender has no Cycles")
        return None
    sizes = [node.image.size[0] for node in nodes if node.type == "TEX_ENVIRONMENT" and node.image is not None]
    width = min(max(sizes, default=WIDTH), MOST_WIDTH)
    _photographed(bpy, world, out / "blender-world.exr", max(width, 64))
    return {"image": "blender-world.exr"}


def _plain(world: Any) -> list[float] | None:
    """The radiance of a world that is one colour; None where it is more."""
    if not world.use_nodes or world.node_tree is None:
        return [float(c) for c in world.color]
    output = next((node for node in world.node_tree.nodes if node.type == "OUTPUT_WORLD" and node.is_active_output), None)
    if output is None or not output.inputs["Surface"].links:
        return [0.0, 0.0, 0.0]
    node = output.inputs["Surface"].links[0].from_node
    if node.type != "BACKGROUND" or any(entry.links for entry in node.inputs) or output.inputs["Volume"].links:
        return None
    strength = float(node.inputs["Strength"].default_value)
    return [max(float(c) * strength, 0.0) for c in node.inputs["Color"].default_value[:3]]


def _photographed(bpy: Any, world: Any, path: Path, width: int) -> None:
    """Writes an equirectangular picture of a world: its middle is what lies along Blender's +Y, which is our -Z."""
    scene = bpy.data.scenes.new("rayfarm world")
    scene.world = world
    data = bpy.data.cameras.new("rayfarm world")
    data.type = "PANO"
    if hasattr(data, "panorama_type"):  # Blender 5; before, Cycles' own
        data.panorama_type = "EQUIRECTANGULAR"
    else:
        data.cycles.panorama_type = "EQUIRECTANGULAR"
    camera = bpy.data.objects.new("rayfarm world", data)
    camera.rotation_euler = (1.5707963267948966, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, width // 2, 100
    render.film_transparent = False
    render.use_compositing = render.use_sequencer = False
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    render.filepath = str(path)
    cycles.device = "CPU"
    cycles.samples = SAMPLES
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.shading_system = False  # no scripts of Open Shading Language
    bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
