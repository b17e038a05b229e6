"""Renders a world with Cycles as a panorama, and measures the sun disk of its sky as a separate light.

A sun of half a degree covers only two texels of the panorama. So the panorama is rendered without the disk, and the disk with a
long lens. Run as a script in a separate Blender process, this bakes the world of a .blend file:

    python skies.py WORLD.blend FOLDER WIDTH
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

__all__ = ["PICTURE", "TOLD", "photographed"]

PICTURE, TOLD = "world.exr", "sun.json"
SAMPLES = 4
LENS_PIXELS, LENS_ROOM = 48, 1.2  # side of the disk's picture in pixels; its width relative to the disk
FORWARD = (1.5707963267948966, 0.0, 0.0)  # Euler angles of a camera that looks along Blender's +Y
LEAST = 1e-9


def photographed(bpy: Any, world: Any, folder: Path, width: int) -> dict[str, Any] | None:
    """Renders a world as a panorama, with Blender's +Y in the middle, to the file PICTURE in the folder.

    Returns the sun disk that the panorama omits, or None if there is none. The sun: direction towards it and irradiance, in
    Blender's axes, and its angular size in radians.
    """
    for output in [node for node in world.node_tree.nodes if node.type == "OUTPUT_WORLD"]:
        for link in list(output.inputs["Volume"].links):  # a medium would hide the world
            world.node_tree.links.remove(link)
    sky = _find_sun_sky(world)
    studio = _Studio(bpy, world)
    sun = None
    try:
        if sky is not None:
            sun = _measure_sun(bpy, studio, sky, folder)
            sky.sun_disc = sun is None
        studio.render_world(folder / PICTURE, width, width // 2, FORWARD, None)
    finally:
        if sky is not None:
            sky.sun_disc = True
        studio.close()
    return sun


def _find_sun_sky(world: Any) -> Any:
    found = [node for node in world.node_tree.nodes if node.type == "TEX_SKY" and hasattr(node, "sun_disc") and node.sun_disc]
    found = [node for node in found if node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")]
    vectors = [entry for node in world.node_tree.nodes if node.type == "TEX_SKY" for entry in node.inputs if entry.is_linked]
    return found[0] if len(found) == 1 and not vectors else None


def _measure_sun(bpy: Any, studio: _Studio, sky: Any, folder: Path) -> dict[str, Any] | None:
    """Returns the direction, irradiance and angle of the sky's sun disk; None if it is too weak.

    The irradiance is the difference of two renderings, with and without the disk. studio: the scene that renders the world. sky:
    the world's sky node.
    """
    import numpy as np
    from mathutils import Vector

    elevation, turn, size = float(sky.sun_elevation), float(sky.sun_rotation), float(sky.sun_size)
    towards = (math.cos(elevation) * math.sin(turn), math.cos(elevation) * math.cos(turn), math.sin(elevation))
    angle = LENS_ROOM * size
    taken = []
    for is_on in (True, False):
        sky.sun_disc = is_on
        path = folder / "sun.exr"
        studio.render_world(path, LENS_PIXELS, LENS_PIXELS, Vector(towards).to_track_quat("-Z", "Y").to_euler(), angle)
        image = bpy.data.images.load(str(path))
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        taken.append(pixels.reshape(-1, image.channels)[:, :3].astype(float))
        bpy.data.images.remove(image)
        path.unlink()
    texel = (2 * math.tan(angle / 2) / LENS_PIXELS) ** 2
    irradiance = ((taken[0] - taken[1]).sum(axis=0) * texel).clip(0)
    if irradiance.max() < LEAST:
        return None
    return {"towards": list(towards), "irradiance": [float(c) for c in irradiance], "angle": size}


class _Studio:
    """The Blender scene in which a world is rendered: it contains only the world and a camera."""

    def __init__(self, bpy: Any, world: Any) -> None:
        self._bpy = bpy
        self._scene = scene = bpy.data.scenes.new("rayfarm world")
        self._data = bpy.data.cameras.new("rayfarm world")
        self._camera = bpy.data.objects.new("rayfarm world", self._data)
        scene.world, scene.camera = world, self._camera
        scene.collection.objects.link(self._camera)
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

    def render_world(self, path: Path, width: int, height: int, rotation: Any, angle: float | None) -> None:
        """Renders the world to a file. rotation: the camera's rotation. angle: field of view in radians; None for a panorama."""
        data, render = self._data, self._scene.render
        data.type = "PANO" if angle is None else "PERSP"
        if angle is not None:
            data.angle = angle
        elif hasattr(data, "panorama_type"):  # Blender 5; before, Cycles' own
            data.panorama_type = "EQUIRECTANGULAR"
        else:
            data.cycles.panorama_type = "EQUIRECTANGULAR"
        self._camera.rotation_euler = rotation
        render.resolution_x, render.resolution_y, render.filepath = width, height, str(path)
        self._bpy.ops.render.render(write_still=True, scene=self._scene.name)

    def close(self) -> None:
        self._bpy.data.scenes.remove(self._scene)


def main(path: str, folder: str, width: str) -> None:
    """Bakes the world of a .blend file, as the command line does."""
    import bpy

    with bpy.data.libraries.load(path) as (given, wanted):
        wanted.worlds = given.worlds[:1]
    sun = photographed(bpy, wanted.worlds[0], Path(folder), int(width))
    (Path(folder) / TOLD).write_text(json.dumps(sun))


if __name__ == "__main__":
    main(*(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]))
