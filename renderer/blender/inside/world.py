"""Converts Blender's world: a constant colour directly, anything else as a panorama rendered by Cycles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from .cameras import to_ours
from .keys import animated_paths, rounded
from .sentences import Sentence

__all__ = ["world_medium", "write_world"]

WIDTH, MOST_WIDTH = 2048, 8192
# By kind of ray, whether the world is visible to it; and the phrase for it.
RAYS = {
    "camera": Sentence("blend-to-camera", "to the camera"),
    "diffuse": Sentence("blend-in-diffuse-light", "in diffuse light"),
    "glossy": Sentence("blend-in-reflections", "in reflections"),
    "transmission": Sentence("blend-through-glass", "through glass"),
}


def write_world(
    bpy: Any, scene: Any, out: Path, skies: Any, notes: list[str]
) -> tuple[dict[str, Any] | None, list[dict[str, Any]]]:
    """Returns (the scene file's environment, the sun of the world's sky as lights); writes the panorama into the folder `out`.

    The environment is None if the world emits no light. skies: the add-on's module; None if not available.
    """
    world = scene.world
    if world is None:
        return None, []
    hidden = [words for kind, words in RAYS.items() if not getattr(getattr(world, "cycles_visibility", None), kind, True)]
    if hidden:
        notes.append(Sentence("blend-world-visibility", "World: visible {where}, unlike in Blender", where=hidden))
    if animated_paths(world.node_tree if world.use_nodes else world):
        notes.append(Sentence("blend-world-animated", "World: its animation is ignored; shown as at the first frame"))
    plain = _constant_radiance(world)
    if plain is not None:
        return ({"color": rounded(plain)} if max(plain) > 0 else None), []
    nodes = world.node_tree.nodes
    if any(node.type == "LIGHT_PATH" for node in nodes):
        notes.append(
            Sentence(
                "blend-world-light-path",
                "World: the camera sees what lights the scene; in Blender, its nodes show the camera something else",
            )
        )
    if "cycles" not in bpy.context.preferences.addons or skies is None:
        notes.append(Sentence("blend-world-without-cycles", "World: its nodes are ignored, since this Blender has no Cycles"))
        return None, []
    sizes = [node.image.size[0] for node in nodes if node.type == "TEX_ENVIRONMENT" and node.image is not None]
    width = min(max(sizes, default=WIDTH), MOST_WIDTH)
    sun = skies.photographed(bpy, world, out, max(width, 64))
    (out / skies.PICTURE).rename(out / "blender-world.exr")
    return {"image": "blender-world.exr"}, [] if sun is None else [_light(world, sun)]


def world_medium(world: Any, subsurface: Any, notes: list[str]) -> dict[str, Any] | None:
    """Returns the medium that fills the world, in Rayfarm's scene format; None if there is none.

    subsurface: the add-on's module of that name; None if not available.
    """
    tree = world.node_tree if world is not None and world.use_nodes else None
    output = None if tree is None else next((n for n in tree.nodes if n.type == "OUTPUT_WORLD" and n.is_active_output), None)
    if output is None or not output.inputs["Volume"].links:
        return None
    if subsurface is None:
        notes.append(Sentence("blend-world-volume-left-out", "World: its volume is left out"))
        return None
    found: dict[str, Any] | None = subsurface.world_medium(
        tree, lambda what: notes.append(Sentence("blend-world", "World: {note}", note=what))
    )
    return found


def _light(world: Any, sun: dict[str, Any]) -> dict[str, Any]:
    is_seen = getattr(getattr(world, "cycles_visibility", None), "camera", True)
    return {
        "type": "directional",
        "name": "sun of the sky",
        "direction": rounded(to_ours([-c for c in sun["towards"]])),
        "intensity": rounded(sun["irradiance"]),
        "angle": math.degrees(sun["angle"]),
        "seen": "always" if is_seen else "mirrored",
    }


def _constant_radiance(world: Any) -> list[float] | None:
    """Returns the radiance of a world with a constant colour; None for other worlds."""
    if not world.use_nodes or world.node_tree is None:
        return [float(c) for c in world.color]
    output = next((node for node in world.node_tree.nodes if node.type == "OUTPUT_WORLD" and node.is_active_output), None)
    if output is None or not output.inputs["Surface"].links:
        return [0.0, 0.0, 0.0]
    node = output.inputs["Surface"].links[0].from_node
    if node.type != "BACKGROUND" or any(entry.links for entry in node.inputs):
        return None
    strength = float(node.inputs["Strength"].default_value)
    return [max(float(c) * strength, 0.0) for c in node.inputs["Color"].default_value[:3]]
