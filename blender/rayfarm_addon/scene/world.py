"""Exports Blender's world as the environment light of a job.

The middle of a panorama is along +X in Blender, and along the farm's -Z, which is Blender's +Y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..farm import exr
from . import images
from .image_nodes import Painter
from .model import Image, Scene, World, to_y_up
from .nodes import SocketInGroups, Source, constant_value, output_of, source_of
from .shader_mix import input_for_camera_rays
from .subsurface import world_medium

__all__ = ["Bake", "read_world"]

Bake = Callable[[Any], tuple[bytes, dict[str, Any] | None] | None]

# Visibility flags of the world by kind of ray, with their names in warnings.
RAYS = {
    "camera": "by the camera",
    "diffuse": "by what it lights",
    "glossy": "in reflections",
    "transmission": "through glass",
}
# Brightness of Blender's skies relative to ours, in which a white surface that faces the sun outside the atmosphere has radiance
# 1. Nishita's sun is 48 to 50 times as bright at elevations from 10 degrees, its sky 49, 47 and 39 times in red, green and blue.
# The older models, which have no disk, are compared by their irradiance on the ground for a sun at 25 degrees.
NISHITA = 49.0
DISKLESS = {"HOSEK_WILKIE": 0.85, "PREETHAM": 6.5}
QUARTER = -90.0  # degrees from the middle of the farm's panorama to that of Blender's


def read_world(scene: Scene, world: Any, bake: Bake | None = None) -> World:
    """Returns the light of a bpy.types.World; black for None.

    bake: renders an unsupported world to an image, see ui/baking.py; if bake is None, such a world is approximated.
    """
    if world is None:
        return World([0.0] * 3)
    if not world.use_nodes or world.node_tree is None:
        return World([float(c) for c in world.color])
    _warn_of_ray_visibility(scene, world)
    inside = world_medium(world.node_tree, lambda what: scene.warn(f"World: {what}."))
    if inside is not None:  # an infinitely distant environment is invisible through it
        return World([0.0] * 3, medium=inside)
    top = output_of(world.node_tree)
    if bake is not None and top is not None and not _is_known(scene, top) and (made := bake(world)) is not None:
        return _baked_world(scene, world, *made)
    source = _background(scene, top)
    if source is None:
        return World([0.0] * 3)
    if source.node.type != "BACKGROUND":
        scene.warn(f"World: the shader {source.node.bl_label} is not read; there is no light from around.")
        return World([0.0] * 3)
    strength = constant_value(source.input("Strength"))
    if strength is None:
        scene.warn("World: what makes its strength is not read; it is 1.")
        strength = 1.0
    color = constant_value(source.input("Color"))
    if color is not None:
        return World([c * strength for c in color])
    node, _ = source_of(source.input("Color"))
    if node is not None and node.node.type == "TEX_ENVIRONMENT" and node.node.image is not None:
        return _image(scene, node, strength)
    if node is not None and node.node.type == "TEX_SKY":
        return _sky(scene, node.node, strength)
    at = source.input("Color")
    painted = _evaluated_panorama(scene, at, strength)
    if painted is not None:
        return painted
    scene.warn("World: what makes its colour is not read; a plain colour stands for it.")
    return World([float(c) * strength for c in at.socket.default_value[:3]] if at is not None else [0.0] * 3)


def _is_known(scene: Scene, top: Source) -> bool:
    """Returns True if the world can be exported without baking: as a colour, or as an image whose mapping the farm supports.

    Worlds that depend on the kind of ray count as supported; another function warns about them.
    """
    if top.node.type == "MIX_SHADER" and input_for_camera_rays(top.input_at(0)) is not None:
        return True
    if top.node.type != "BACKGROUND" or constant_value(top.input("Strength")) is None:
        return False
    if constant_value(top.input("Color")) is not None:
        return True
    node, _ = source_of(top.input("Color"))
    if node is None or node.node.type == "TEX_SKY":
        return False
    probe = Scene()  # collects the warnings of a trial export
    if node.node.type == "TEX_ENVIRONMENT" and node.node.image is not None:
        return node.node.projection == "EQUIRECTANGULAR" and _environment_rotation(probe, node) is not None and not probe.warnings
    return _evaluated_panorama(probe, top.input("Color"), 1.0) is not None and not probe.warnings


def _baked_world(scene: Scene, world: Any, content: bytes, sun: dict[str, Any] | None) -> World:
    if sun is not None:
        is_seen = getattr(getattr(world, "cycles_visibility", None), "camera", True)
        said = {
            "direction": to_y_up(-np.array(sun["towards"])),
            "intensity": sun["irradiance"],
            "angle": math.degrees(sun["angle"]),
        }
        scene.lights.append(
            {"type": "directional", "name": "sun of the sky", **said, "seen": "always" if is_seen else "mirrored"}
        )
    return World(image=Image("world.exr", content))


def _warn_of_ray_visibility(scene: Scene, world: Any) -> None:
    hidden = [words for kind, words in RAYS.items() if not getattr(getattr(world, "cycles_visibility", None), kind, True)]
    if hidden:
        scene.warn(f"World: is seen {', '.join(hidden)} here, though not in Blender.")


def _background(scene: Scene, source: Source | None) -> Source | None:
    """Returns the shader of a world that lights the scene; warns if camera rays see another shader."""
    if (
        source is not None
        and source.node.type == "MIX_SHADER"
        and (which := input_for_camera_rays(source.input_at(0))) is not None
    ):
        scene.warn("World: the camera sees what lights, though in Blender it sees something else.")
        return source_of(source.input_at(2 - which))[0]
    return source


def _evaluated_panorama(scene: Scene, socket: SocketInGroups | None, strength: float) -> World | None:
    """Returns the light of a world whose nodes modify panoramas, evaluated texel by texel.

    Returns None if a node is not supported, or if an image is not an equirectangular panorama.
    """

    def turn_of(source: Source) -> Any:
        node = source.node
        is_whole = node.type == "TEX_ENVIRONMENT" and node.projection == "EQUIRECTANGULAR"
        return ("turned", _environment_rotation(scene, source)) if is_whole else None

    found = Painter("world", turn_of).paint(socket, "colour")
    if found is None:
        return None
    if isinstance(found, list):
        return World([c * strength for c in found])
    made, use = found
    light: Any = use  # the result of `turn_of`
    content = exr.write(np.maximum(made.texels[..., :3], 0))
    return World(image=Image("world.exr", content), strength=strength, rotation=QUARTER + light[1])


def _image(scene: Scene, source: Source, strength: float) -> World:
    node = source.node
    if node.projection != "EQUIRECTANGULAR":
        scene.warn("World: a mirror ball's picture is not read; there is no light from around.")
        return World([0.0] * 3)
    image = images.lights_with(node.image)
    if image is None:
        scene.warn(f"World: the picture {node.image.name} has no pixels; is its file there?")
        return World([0.0] * 3)
    return World(image=image, strength=strength, rotation=QUARTER + _environment_rotation(scene, source))


def _environment_rotation(scene: Scene, source: Source) -> float:
    """Returns the rotation of the environment about the up axis, in degrees."""
    found, _ = source_of(source.input("Vector"))
    if found is None or found.node.type == "TEX_COORD":
        return 0.0
    if found.node.type != "MAPPING":
        scene.warn("World: how its picture is turned is not read.")
        return 0.0
    turn = constant_value(found.input("Rotation")) or [0.0] * 3
    rest = [constant_value(found.input(name)) for name in ("Location", "Scale")]
    if abs(turn[0]) > 1e-4 or abs(turn[1]) > 1e-4 or rest not in ([[0.0] * 3, [1.0] * 3], [None, [1.0] * 3]):
        scene.warn("World: its picture is turned about Z alone.")
    # The node rotates the lookup direction, so the picture rotates in the opposite direction.
    return math.degrees(turn[2] if found.node.vector_type == "TEXTURE" else -turn[2])


def _sky(scene: Scene, node: Any, strength: float) -> World:
    """Returns the farm's sky model, scaled to Blender's brightness: nearly the same for equal air, dust and ozone."""
    scene.warn(
        "World: its sky is the farm's own clear sky with the sun at the same place; it differs by some percent, and more "
        "below the horizon."
    )
    kind = getattr(node, "sky_type", "")
    if kind in DISKLESS:
        x, y, z = node.sun_direction
        elevation, azimuth = math.degrees(math.asin(max(-1.0, min(1.0, z)))), math.degrees(math.atan2(x, y))
        said = {"sun_elevation": elevation, "sun_azimuth": azimuth % 360, "sun": False}
        return World(sky=said, strength=strength * DISKLESS[kind])
    if abs(getattr(node, "sun_intensity", 1.0) - 1) > 1e-3 or getattr(node, "altitude", 0.0) > 100:
        scene.warn("World: its sun is as bright as the sky's, and seen from sea level.")
    said = {
        "sun_elevation": math.degrees(max(-math.pi / 2, min(math.pi / 2, node.sun_elevation))),
        "sun_azimuth": math.degrees(node.sun_rotation) % 360,
        "sun": bool(node.sun_disc),
        "sun_size": max(0.01, min(30.0, math.degrees(node.sun_size))),
        "ground_albedo": 0,
    }
    said |= {name: float(getattr(node, f"{name}_density", 1.0)) for name in ("air", "dust", "ozone")}
    return World(sky=said, strength=strength * NISHITA)
