"""Renders the angular emission of point and spot lights with nodes (IES profiles, images, patterns) to an image, with Cycles.

A copy of the light, without a size, illuminates the inside of a white sphere from its centre. A camera there sees the sphere's
radiance: the light's radiant intensity divided by pi.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from .keys import animated_paths

__all__ = ["EmissionImage", "is_animated_light", "needs_emission_image", "render_emission_image"]

MAX_WINDOW_ANGLE = 120.0  # degrees: cones up to this are rendered by a perspective camera
SIDE, AROUND = 512, 1024  # pixels: side of a perspective image, and width of a panorama
MOST = 2048
SAMPLES = 4
SPHERE_FACES = (256, 128)  # faces of the sphere: around, and from pole to pole
VIEW_DEPENDENT_NODES = ("LIGHT_FALLOFF", "LIGHT_PATH")  # nodes that depend on the distance or the kind of ray


class EmissionImage(NamedTuple):
    """A linear image of a light's emission by direction, stored next to the scene file.

    It multiplies the emission that the light has without its nodes.
    """

    file: str
    is_window: bool  # whether it covers the light's cone, instead of all directions


def needs_emission_image(bpy: Any, data: Any) -> bool:
    """Returns True if a light has nodes that are not all constant and that can be rendered to an image."""
    if data.type not in ("POINT", "SPOT") or "cycles" not in bpy.context.preferences.addons:
        return False
    return not any(node.type in VIEW_DEPENDENT_NODES for node in _nodes(data.node_tree))


def render_emission_image(bpy: Any, lamp: Any, out: Path, name: str) -> EmissionImage:
    """Renders the emission image of the light object `lamp` to the file `name` in the folder `out`."""
    is_window = lamp.data.type == "SPOT" and math.degrees(lamp.data.spot_size) <= MAX_WINDOW_ANGLE
    sizes = [max(node.image.size) for node in _nodes(lamp.data.node_tree) if getattr(node, "image", None) is not None]
    width = min(max([SIDE if is_window else AROUND, *sizes]), MOST)
    studio = _Studio(bpy, lamp, is_window)
    try:
        studio.render_profile(out / name, width, width if is_window else width // 2)
    finally:
        studio.close()
    return EmissionImage(name, is_window)


def is_animated_light(data: Any) -> bool:
    """Returns True if properties of a light's nodes are animated."""
    return bool(animated_paths(data.node_tree))


def _nodes(tree: Any) -> list[Any]:
    found = []
    for node in tree.nodes:
        found.append(node)
        if node.type == "GROUP" and node.node_tree is not None:
            found += _nodes(node.node_tree)
    return found


class _Studio:
    """The Blender scene in which a light's emission is rendered: only the light and a sphere around it."""

    def __init__(self, bpy: Any, lamp: Any, is_window: bool) -> None:
        self._bpy, self._is_window = bpy, is_window
        self._scene = scene = bpy.data.scenes.new("rayfarm lamp")
        self._light = light = lamp.data.copy()
        light.energy, light.color, light.shadow_soft_size = 4 * math.pi**2, (1.0, 1.0, 1.0), 0.0
        for name, value in (("use_temperature", False), ("exposure", 0.0), ("normalize", True)):
            if hasattr(light, name):
                setattr(light, name, value)
        if is_window:
            light.spot_blend = 0.0  # the scene file's spot has the soft edge
        place = lamp.matrix_world.copy()
        self._camera = bpy.data.cameras.new("rayfarm lamp")
        self._ball = bpy.data.meshes.new("rayfarm lamp")
        self._add_sphere(place)
        things = [("lamp", light, place), ("camera", self._camera, place.normalized()), ("ball", self._ball, None)]
        self._things = []
        for name, data, at in things:
            thing = bpy.data.objects.new(f"rayfarm {name}", data)
            if at is not None:
                thing.matrix_world = at
            scene.collection.objects.link(thing)
            self._things.append(thing)
        scene.camera = self._things[1]
        render, cycles = scene.render, scene.cycles
        render.engine = "CYCLES"
        render.resolution_percentage = 100
        render.film_transparent = render.use_compositing = render.use_sequencer = False
        render.image_settings.file_format = "OPEN_EXR"
        render.image_settings.color_mode = "RGB"
        render.image_settings.color_depth = "32"
        cycles.device, cycles.samples, cycles.pixel_filter_type = "CPU", SAMPLES, "BOX"
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.shading_system = False  # no scripts of Open Shading Language
        cycles.max_bounces = 0
        cycles.light_sampling_threshold = cycles.sample_clamp_direct = 0.0

    def _add_sphere(self, place: Any) -> None:
        """Adds the faces of a sphere of radius 1 to the sphere's mesh, with normals towards its centre."""
        import bmesh
        from mathutils import Matrix

        shape = bmesh.new()
        bmesh.ops.create_uvsphere(shape, u_segments=SPHERE_FACES[0], v_segments=SPHERE_FACES[1], radius=1.0)
        bmesh.ops.transform(shape, matrix=Matrix.Translation(place.translation), verts=shape.verts)
        for face in shape.faces:
            face.smooth = True
        shape.to_mesh(self._ball)
        shape.free()
        white = self._bpy.data.materials.new("rayfarm lamp")
        white.use_nodes = True
        tree = white.node_tree
        tree.nodes.clear()
        matt, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
        matt.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        tree.links.new(matt.outputs[0], output.inputs["Surface"])
        self._ball.materials.append(white)
        self._white = white

    def render_profile(self, path: Path, width: int, height: int) -> None:
        camera, render = self._camera, self._scene.render
        camera.type = "PERSP" if self._is_window else "PANO"
        camera.clip_start = 1e-3
        if self._is_window:
            camera.angle = self._light.spot_size
        elif hasattr(camera, "panorama_type"):  # Blender 5; before, Cycles' own
            camera.panorama_type = "EQUIRECTANGULAR"
        else:
            camera.cycles.panorama_type = "EQUIRECTANGULAR"
        render.resolution_x, render.resolution_y, render.filepath = width, height, str(path)
        self._bpy.ops.render.render(write_still=True, scene=self._scene.name)

    def close(self) -> None:
        data = self._bpy.data
        for thing in self._things:
            data.objects.remove(thing)
        data.scenes.remove(self._scene)
        data.lights.remove(self._light)
        data.cameras.remove(self._camera)
        data.meshes.remove(self._ball)
        data.materials.remove(self._white)
