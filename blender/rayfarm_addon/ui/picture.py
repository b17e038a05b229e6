"""Converts Blender's scene at a frame to a request to a farm."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..farm.render_request import Light, RenderRequest
from ..scene.cameras import NAME, lens_of, shot_of_camera, with_keys
from ..scene.cycles import depths_of, rolling_shutter_of, takes_time, warn_of_region
from ..scene.files import FPS, MAIN, scene_files
from ..scene.gather import export_scene, extends_beyond_clip_end, over_the_shutter
from ..scene.ids import Ids, ids_of
from ..scene.model import World
from ..scene.view import Shot
from .baking import baked_panorama

__all__ = ["Picture", "frame_and_subframe", "light_of", "picture_of", "requested"]

F64 = npt.NDArray[np.float64]
FRAME = 64  # frame number of pictures with motion blur in the exported file, large enough that no key is before time 0
LARGEST = 16_384  # pixels per side


@dataclass(frozen=True)
class Picture:
    """The exported frame as a request to the farm, with the part of the image that is needed and the warnings of the export."""

    asked: RenderRequest
    shot: Shot
    ids: Ids
    warnings: list[str]


def requested(scene: Any, spp: int) -> dict[str, Any]:
    """Returns the fields of a request that are set by the user in the scene's settings."""
    settings = scene.rayfarm
    found = {"spp": spp, "max_depth": settings.depth, "seed": settings.seed, "filter": settings.filter, **depths_of(scene)}
    if scene.render.film_transparent:
        found["background"] = "transparent"
    return found | ({"clamp_indirect": settings.clamp} if settings.clamp > 0 else {})


def light_of(world: World) -> Light:
    """Returns a World as the Light of a request."""
    image = None if world.image is None else (world.image.name, world.image.content)
    return Light(world.color, image, world.sky is not None, world.strength, world.rotation)


def _border(render: Any, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    if not render.use_border:
        return None
    (w, h) = size
    x0, x1 = (int(share * w) for share in (render.border_min_x, render.border_max_x))
    y0, y1 = (int(share * h) for share in (render.border_min_y, render.border_max_y))
    return x0, y0, max(x1, x0 + 1), max(y1, y0 + 1)


def picture_of(
    depsgraph: Any, place_of: Callable[[Any], F64], go_to: Callable[[float], None], planes: tuple[str, ...], title: str
) -> Picture:
    """Exports Blender's current frame; returns the exported files with the request that renders them on the farm.

    Raises ValueError if there is nothing to render.

    depsgraph: Blender's evaluated scene. place_of: returns the transform of a camera object as a 4 x 4 matrix. go_to: sets
    Blender to a frame number, which may lie between two frames. planes: names of the AOVs to request. title: name of the job.
    """
    blender = depsgraph.scene
    render, settings = blender.render, blender.rayfarm
    if blender.camera is None:
        raise ValueError("The scene has no camera.")
    size = tuple(max(int(n * render.resolution_percentage / 100), 1) for n in (render.resolution_x, render.resolution_y))
    frame = blender.frame_current + blender.frame_subframe
    length = float(render.motion_blur_shutter) if takes_time(blender, depsgraph.view_layer) else 0.0
    middle = frame + {"START": length / 2, "END": -length / 2}.get(render.motion_blur_position, 0.0)
    if length and middle != frame:
        go_to(middle)
    *_, found = export_scene(depsgraph, {}, bake=baked_panorama)
    scene = found.scene

    def camera() -> tuple[F64, F64, Any]:
        thing = blender.camera.evaluated_get(depsgraph)
        scale = {"scale_x": render.pixel_aspect_x, "scale_y": render.pixel_aspect_y}
        projection = thing.calc_matrix_camera(depsgraph, x=size[0], y=size[1], **scale)
        return place_of(thing), np.array(projection, np.float64), thing

    place, projection, thing = camera()
    if thing.data.type != "PANO" and extends_beyond_clip_end(scene, place[:3, 3], -place[:3, 2], float(thing.data.clip_end)):
        scene.warn(f"Camera: what lies beyond its end of {thing.data.clip_end:g} is shown, though not in Blender.")
    border = _border(render, size)
    shot = shot_of_camera(scene, thing, place, projection, size, border)
    if max(shot.width, shot.height) > LARGEST:
        raise ValueError(
            f"The picture has {shot.width:,} x {shot.height:,} pixels; the farm's have at most {LARGEST:,} along each side. "
            "Lower the resolution, or render a region of it."
        )
    request = requested(blender, settings.samples) | {"width": shot.width, "height": shot.height}
    request |= {"priority": settings.priority} | ({"noise": settings.noise} if settings.use_noise else {})
    moves = False
    if length:
        over: list[Any] = []

        def at(offset: float) -> tuple[float, Callable[[], Any]]:
            time = (FRAME + offset - (middle - frame)) / FPS

            def evaluate_frame() -> Any:
                go_to(frame + offset)
                over.append((time, *camera()[:2], lens_of(None, blender.camera.evaluated_get(depsgraph))))
                return depsgraph

            return time, evaluate_frame

        ends = middle - frame - length / 2
        over_the_shutter(found, [at(ends + length * i / (settings.keys - 1)) for i in range(settings.keys)])
        moves = shot.view.get("projection") != "panorama" and with_keys(scene, shot, over, size, border)
        go_to(frame)
        if moves or any(node.places for node in scene.nodes) or any(mesh.shapes for mesh in scene.meshes.values()):
            request |= {"frame": FRAME, "shutter": length, "shutter_at": "centred"}
            if readout := rolling_shutter_of(blender):
                request |= {"rolling_shutter": readout}
                if border is not None:
                    warn_of_region(scene.warn)
    request |= {"camera": NAME} if moves else {"view": shot.view}
    files = scene_files(scene)
    asked = RenderRequest(files, MAIN, title, light_of(scene.world), request, planes, settings.denoise)
    return Picture(asked, shot, ids_of(scene), scene.warnings)


def frame_and_subframe(frame: float) -> tuple[int, float]:
    """Splits a frame number into an integer and a fraction, as Blender needs it."""
    whole = math.floor(frame + 1e-9)
    return whole, max(frame - whole, 0.0)
